"""The guide in an image that shows too few of its balls to be named alone, with the help of another image.

An oblique image with wires often shows half of the guide. Its balls fit more than one position then; but from another
image of the same set-up it is known where the nail lies from the guide, and the nail is the darkest band of the image.
Each way to name the balls puts the nail somewhere: only that counts which puts it where a band of metal is.
"""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.guide.identity import GuideIdentity
from services.registration.core.guide.locate import GuideFit, Named, guide_identities, measured_guide
from services.registration.core.localise import Parts
from services.registration.core.wires.view import in_border
from shared.errors import Accepted, Reason, ReasonCode, Rejected
from shared.figures import figure
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

LEAST_BALLS = 7
LEAST_BAND, LEAST_BAND_MARGIN = 0.55, 0.2
_PROXIMAL_OF_HOLES_MM, _STEP_MM = 30.0, 1.0
_INSIDE, _OUTSIDE = 0.6, 1.6
_LEAST_CONTRAST = 0.25
_LEAST_POINTS = 20


def locate_guide_beside(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, guide_from_nail: Transform[Guide, Nail]
) -> Accepted[GuideFit] | Rejected:
    """Find the guide in an un-mirrored image, given where the nail lies from it."""
    named = [one for one in guide_identities(calibration, parts.guide) if len(one) >= LEAST_BALLS]
    bands = np.array([_band(pixels, calibration, parts.nail, _pose(one) @ guide_from_nail) for one in named])
    order = np.argsort(-bands, kind="stable")
    best = float(bands[order[0]]) if len(order) else 0.0
    second = float(bands[order[1]]) if len(order) > 1 else 0.0
    if best < LEAST_BAND or best - second < LEAST_BAND_MARGIN:
        return Rejected((_not_found(len(named), best, second),))
    chosen = named[order[0]]
    others = [len(one) for one in named if one is not chosen]
    margin = len(chosen) - max(others, default=0)
    return measured_guide(pixels, calibration, parts.ring, parts.guide, Named(chosen, margin, LEAST_BALLS))


def _pose(identity: GuideIdentity) -> Transform[Camera, Guide]:
    return Transform.from_rotation_translation(identity.pose.rotation, identity.pose.translation_mm)


def _band(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    nail: NailPart,
    camera_from_nail: Transform[Camera, Nail],
) -> float:
    """Share of the places along the nail, on both sides, that are much darker than what lies beside."""
    if float(camera_from_nail.translation_mm[2]) <= nail.diameter_mm:
        return 0.0
    along = [float(hole.axis.point_mm[0]) for hole in nail.holes]
    x = np.arange(min(along) - _PROXIMAL_OF_HOLES_MM, nail.tip_x_mm - nail.radius_mm, _STEP_MM)
    ray_nail = camera_from_nail.rotation.T @ unit(camera_from_nail.translation_mm)
    aside = unit(np.cross([1.0, 0.0, 0.0], ray_nail))
    usable = in_border(calibration)
    dark, light = np.percentile(pixels[usable], [2.0, 90.0]) if usable.any() else (0.0, 0.0)
    on_axis = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    hits, seen = 0, 0
    for side in (-1.0, 1.0):
        greys = []
        visible = np.ones(len(x), dtype=np.bool_)
        for share in (_INSIDE, _OUTSIDE):
            points = on_axis + side * share * nail.radius_mm * aside
            column, row = np.rint(calibration.image_from_camera(camera_from_nail @ points)).astype(np.int64).T
            inside = (column >= 0) & (column < usable.shape[1]) & (row >= 0) & (row < usable.shape[0])
            row, column = np.clip(row, 0, usable.shape[0] - 1), np.clip(column, 0, usable.shape[1] - 1)
            visible &= inside & usable[row, column]
            greys.append(pixels[row, column])
        hits += int(np.count_nonzero(visible & (greys[1] - greys[0] > _LEAST_CONTRAST * (light - dark))))
        seen += int(np.count_nonzero(visible))
    return hits / seen if seen >= _LEAST_POINTS else 0.0


def _not_found(ways: int, best: float, second: float) -> Reason:
    return Reason(
        ReasonCode.GUIDE_NOT_FOUND,
        f"{ways} ways to name {LEAST_BALLS} balls of the guide or more were tried with the nail's place known from the "
        f"other image: the best puts {figure(100.0 * best, 100.0 * LEAST_BAND, 0)} % of the nail on metal (limit "
        f"{100.0 * LEAST_BAND:.0f} %), the next {100.0 * second:.0f} % (limit {100.0 * LEAST_BAND_MARGIN:.0f} % less); "
        "move the C-arm until more of the guide is in the image, with the nail, and take the image again",
    )

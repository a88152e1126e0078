"""The paper's registration: when the holes look round, their axes are taken to be the camera's axis.

"The orientation of the C-arm is adjusted until the holes appear as circles as opposed to ellipses": the measure is the
aspect ratio of an ellipse fitted to each hole's outline, and the axis is then the direction in which the camera looks.
What limits it is written in the comparison of both methods: a hole looks round when the *ray through it* is parallel to
it, which differs from the camera's axis by up to a few degrees away from the image's centre; and an aspect ratio has no
sign and little slope near one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.search.find import NailDetection, camera_from_nail_facing
from services.registration.core.nail.search.outline import Ellipse
from shared.errors import Accepted, Reason, ReasonCode, Rejected
from shared.figures import figure
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

LOWEST_ASPECT_RATIO = 0.93


@dataclass(frozen=True, slots=True, eq=False)
class SeenNail:
    """What the rule needs to know.

    Attributes
    ----------
    outlines
        Ellipse of each hole's outline in ideal pixels, in the order of the nail's file.
    distal_camera
        Rough direction of the nail's +x, shape (3,).
    depth_from_width_mm
        Distance from the focal spot that the nail's width gives; used when there is one hole.
    """

    outlines: tuple[Ellipse, ...]
    distal_camera: NDArray[np.float64]
    depth_from_width_mm: float

    @staticmethod
    def of_start(start: NailDetection) -> "SeenNail":
        """As the project's own coarse search saw the nail."""
        return SeenNail(
            tuple(opening.ellipse for opening in start.openings),
            start.camera_from_nail.directions(np.array([1.0, 0.0, 0.0])),
            float(start.camera_from_nail.translation_mm[2]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class FrontoParallelNail:
    """The nail as the paper's method sees it.

    Attributes
    ----------
    camera_from_nail
        The holes' mean axis is the camera's z axis.
    circularity
        Minor over major axis of the ellipse fitted to each hole's outline, in the order of the nail's file.
    """

    camera_from_nail: Transform[Camera, Nail]
    circularity: tuple[float, ...]


def along_the_beam(
    seen: SeenNail, calibration: CArmCalibration, nail: NailPart
) -> Accepted[FrontoParallelNail] | Rejected:
    """Judge the roundness of the holes, and take the camera's axis for theirs.

    Returns
    -------
    Accepted or Rejected
        Rejected with `tilt_too_large` when a hole does not look round.
    """
    circularity = tuple(minor / major for major, minor in (outline.semi_axes_px for outline in seen.outlines))
    worst = int(np.argmin(circularity))
    if circularity[worst] < LOWEST_ASPECT_RATIO:
        message = (
            f"nail hole '{nail.holes[worst].id}' has an aspect ratio of "
            f"{figure(circularity[worst], LOWEST_ASPECT_RATIO, 3)} (limit {LOWEST_ASPECT_RATIO}); turn the C-arm until "
            "the holes look round, or use the model method"
        )
        return Rejected((Reason(ReasonCode.TILT_TOO_LARGE, message),))
    rays = calibration.camera.rays(np.array([outline.centre_px for outline in seen.outlines]))
    beam = np.array([0.0, 0.0, 1.0])
    pose = camera_from_nail_facing(nail, rays, beam, seen.distal_camera, seen.depth_from_width_mm)
    return Accepted(FrontoParallelNail(pose, circularity))

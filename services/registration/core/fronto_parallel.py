"""The paper's own method, as the baseline: when the holes look round, their axes are taken to be the camera's axis.

"The orientation of the C-arm is adjusted until the holes appear as circles as opposed to ellipses": the measure is the
aspect ratio of an ellipse fitted to each hole's outline, and the axis is then the direction in which the camera looks.
What limits it is written in the comparison of both methods: a hole looks round when the *ray through it* is parallel to
it, which differs from the camera's axis by up to a few degrees away from the image's centre; and an aspect ratio has no
sign and little slope near one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.coarse import NailStart, find_nail
from services.registration.core.nail.coarse_pose import camera_from_nail_facing
from shared.errors import Accepted, Reason, ReasonCode, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

LOWEST_ASPECT_RATIO = 0.93


@dataclass(frozen=True, slots=True, eq=False)
class FrontoParallelNail:
    """The nail as the paper's method sees it.

    Attributes
    ----------
    camera_from_nail
        The holes' mean axis is the camera's z axis.
    circularity
        Minor over major axis of the ellipse fitted to each hole's outline, in the order of the nail's file.
    start
        What the ellipses were measured on.
    """

    camera_from_nail: Transform[Camera, Nail]
    circularity: tuple[float, ...]
    start: NailStart


def locate_fronto_parallel(
    pixels: NDArray[np.generic],
    calibration: CArmCalibration,
    nail: NailPart,
    distal_hint_camera: NDArray[np.float64] | None = None,
) -> Accepted[FrontoParallelNail] | Rejected:
    """Locate the nail by the paper's method.

    Parameters
    ----------
    pixels, distal_hint_camera
        As for `find_nail`.

    Returns
    -------
    Accepted or Rejected
        Rejected as by `find_nail`, or with `tilt_too_large` when a hole does not look round.
    """
    found = find_nail(pixels, calibration, nail, distal_hint_camera)
    if isinstance(found, Rejected):
        return found
    return fronto_parallel_from_start(found.value, calibration, nail)


def fronto_parallel_from_start(
    start: NailStart, calibration: CArmCalibration, nail: NailPart
) -> Accepted[FrontoParallelNail] | Rejected:
    """Judge the roundness of the openings that were found, and take the camera's axis for the holes'."""
    circularity = tuple(opening.ellipse.aspect_ratio for opening in start.openings)
    worst = int(np.argmin(circularity))
    if circularity[worst] < LOWEST_ASPECT_RATIO:
        message = (
            f"nail hole '{start.openings[worst].hole_id}' has an aspect ratio of {circularity[worst]:.3f} "
            f"(limit {LOWEST_ASPECT_RATIO}); turn the C-arm until the holes look round, or use the model method"
        )
        return Rejected((Reason(ReasonCode.TILT_TOO_LARGE, message),))
    rays = calibration.camera.rays(np.array([opening.ellipse.centre_px for opening in start.openings]))
    pose = camera_from_nail_facing(
        nail,
        rays,
        np.array([0.0, 0.0, 1.0]),
        start.camera_from_nail.directions(np.array([1.0, 0.0, 0.0])),
        float(start.camera_from_nail.translation_mm[2]),
    )
    return Accepted(FrontoParallelNail(pose, circularity, start))

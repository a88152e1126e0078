"""The paper's nail, from pixels to pose: edges, band, holes, ellipses, roundness, camera's axis."""

import numpy as np
from numpy.typing import NDArray

from baselines.fronto_parallel.axis_rule import FrontoParallelNail, SeenNail, along_the_beam
from baselines.fronto_parallel.band import find_band
from baselines.fronto_parallel.edges import edge_image
from baselines.fronto_parallel.holes import find_holes
from shared.errors import Accepted, Reason, ReasonCode, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import NailPart


def locate_nail_by_band(
    upright: NDArray[np.float32],
    calibration: CArmCalibration,
    nail: NailPart,
    distal_camera: NDArray[np.float64] | None,
    balls_px: NDArray[np.float64],
) -> Accepted[FrontoParallelNail] | Rejected:
    """Locate the nail by the paper's method.

    Parameters
    ----------
    upright
        Un-mirrored image, darker is denser, shape (rows, columns).
    distal_camera
        Rough direction of the nail's +x in the camera frame, shape (3,): the guide's +x. A band with two holes looks
        the same from both ends, and the paper knows no other mark.
    balls_px
        Measured pixels and radii of the balls' shadows, shape (K, 3): their rims are no edges of the nail's.

    Returns
    -------
    Accepted or Rejected
        Rejected with `nail_not_found`, `hole_not_visible` or `tilt_too_large`.
    """
    image = edge_image(upright, calibration, balls_px)
    band = find_band(image, calibration, nail)
    if band is None:
        return _rejected(
            ReasonCode.NAIL_NOT_FOUND,
            f"no two parallel edges of a {nail.diameter_mm:g} mm nail's distance with darkness between them were found "
            "in the image; bring the nail's distal end into view, or check the nail file",
        )
    if distal_camera is None:
        return _rejected(
            ReasonCode.NAIL_NOT_FOUND,
            "the nail's edges were found, but without the drill guide this method cannot tell which end is distal; "
            "bring the drill guide into view",
        )
    seen = find_holes(image, band, nail, distal_camera[:2])
    outlines = tuple(hole.ellipse for hole in seen if hole is not None)
    if len(outlines) < len(seen):
        missing = ", ".join(f"'{hole.id}'" for hole, found in zip(nail.holes, seen, strict=True) if found is None)
        return _rejected(
            ReasonCode.HOLE_NOT_VISIBLE,
            f"no ellipse fits the edges where nail hole {missing} should be; turn the C-arm, move the guide's balls "
            "off the hole, or use the model method",
        )
    depth_mm = nail.diameter_mm * calibration.camera.focal_length_px / band.width_px
    return along_the_beam(SeenNail(outlines, distal_camera, depth_mm), calibration, nail)


def _rejected(code: ReasonCode, message: str) -> Rejected:
    return Rejected((Reason(code, message),))

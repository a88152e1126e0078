"""Write source and distortion as the pinhole camera, pose and displacement grid that registration uses.

The camera looks across the ring's plane z = 0, so that ideal pixels are that plane, scaled and turned. Which plane is
called ideal is free: the distortion absorbs the choice, and the rays do not depend on it.
"""

from dataclasses import dataclass

import numpy as np

from services.imaging.core.distortion_field import FieldSolution
from services.imaging.core.joint_estimate import Gauge
from services.imaging.core.tuning import DISTORTION_MODEL
from shared.geometry.calibration import Aperture, BallCandidates, CArmCalibration
from shared.geometry.camera import DisplacementField, PinholeCamera
from shared.geometry.frames import Camera, Ring
from shared.geometry.transform import Transform
from shared.xray.discs import Array


@dataclass(frozen=True, slots=True, eq=False)
class SourceAndField:
    """Focal spot in the ring's frame (mm) with covariance, gauge, and the distortion on a grid."""

    source_mm: Array
    source_covariance_mm2: Array
    gauge: Gauge
    field: DisplacementField


def field_on_grid(
    solution: FieldSolution, width_px: int, height_px: int, aperture: Aperture | None
) -> DisplacementField:
    """Sample the estimated distortion on a regular grid that covers the image.

    Nodes far outside the aperture take the value of the nearest place just outside it: there is nothing to measure
    there, and a cubic polynomial would run away.
    """
    spacing = max(width_px, height_px) / DISTORTION_MODEL.nodes
    x = np.arange(-1, int(np.ceil(width_px / spacing)) + 2) * spacing
    y = np.arange(-1, int(np.ceil(height_px / spacing)) + 2) * spacing
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    if aperture is not None:
        nodes = _drawn_in(nodes, np.array(aperture.centre_px), aperture.radius_px + DISTORTION_MODEL.beyond * spacing)
    displacement, deviation = solution.predict(nodes)
    shape = (len(y), len(x))
    return DisplacementField(
        np.array([x[0], y[0]]), float(spacing), displacement.reshape(*shape, 2), deviation.reshape(shape)
    )


def _drawn_in(points: Array, centre: Array, radius: float) -> Array:
    """Points outside a circle moved to its nearest point."""
    offset = points - centre
    distance = np.hypot(*offset.T)
    return np.asarray(centre + offset * np.minimum(1.0, radius / np.maximum(distance, 1e-9))[:, None])


def build_calibration(
    model: SourceAndField,
    width_px: int,
    height_px: int,
    *,
    mirrored: bool,
    aperture: Aperture | None,
    balls: BallCandidates,
    balls_expected: int,
    distortion_residual_px: float,
    reprojection_rms_px: float,
    runner_up_margin: float,
) -> CArmCalibration:
    """Assemble the calibration; see `CArmCalibration` for the parameters."""
    gauge, source = model.gauge, model.source_mm
    principal = gauge.pixels(source[None, :2])[0]
    focal = gauge.scale_px_per_mm * -source[2]
    intrinsic = np.array([[focal, 0.0, principal[0]], [0.0, focal, principal[1]], [0.0, 0.0, 1.0]])
    rotation = np.eye(3)
    rotation[:2, :2] = gauge.rotation
    pose: Transform[Camera, Ring] = Transform.from_rotation_translation(rotation, -rotation @ source)
    return CArmCalibration(
        width_px=width_px,
        height_px=height_px,
        mirrored=mirrored,
        camera=PinholeCamera(intrinsic),
        camera_from_ring=pose,
        distortion=model.field,
        source_covariance_mm2=model.source_covariance_mm2,
        balls=balls,
        balls_expected=balls_expected,
        distortion_residual_px=distortion_residual_px,
        reprojection_rms_px=reprojection_rms_px,
        runner_up_margin=runner_up_margin,
        aperture=aperture,
    )

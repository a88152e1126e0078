"""Estimates of `guide_from_nail` from one image as a test states them: good across its ray, weak along it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.estimation.joint import fuse
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.fusion import disagreement
from shared.errors import Reason
from shared.geometry.frames import Guide, Nail
from shared.geometry.transform import Transform
from tests.unit.services.registration.core.test_hole_axes import NAIL_POSE
from tests.unit.services.registration.rendered_case import rendered_parts
from tests.unit.services.registration.stated_errors import errors_without_shape
from tests.unit.services.registration.xray_scene import nail_part

Estimate = PoseEstimate[Guide, Nail]
POSE: Transform[Guide, Nail] = Transform.from_rotvec(np.radians([1.0, -2.0, 1.5]), [1.0, -2.0, 115.0])
SIGMAS = np.concatenate([np.radians([0.12, 0.10, 0.02]), [0.03, 0.03]])
DEPTH_SD_MM = 0.5
FROM_ABOVE = (0.0, 0.0)


def evidence(lean_deg: tuple[float, float] = FROM_ABOVE, pose: Transform[Guide, Nail] = POSE) -> Estimate:
    """An image whose beam leans against the nail's z axis: good across its ray, weak along it."""
    ray = Rotation.from_rotvec(np.radians([*lean_deg, 0.0])).apply([0.0, 0.0, 1.0])
    covariance = np.diag(np.concatenate([SIGMAS, [0.03]]) ** 2)
    covariance[3:, 3:] += DEPTH_SD_MM**2 * np.outer(ray, ray)
    by_model = np.diag(np.radians([0.04, 0.04, 0.02, 0.0, 0.0, 0.0]))
    return PoseEstimate(pose, replace(errors_without_shape(covariance, by_model), ray=ray))


def shifted(one: Estimate, motion: NDArray[np.float64]) -> Estimate:
    return replace(one, mean=one.mean.moved(motion))


def with_errors(
    one: Estimate,
    image_covariance: NDArray[np.float64] | None = None,
    shape_deviations: NDArray[np.float64] | None = None,
    model_loadings: NDArray[np.float64] | None = None,
) -> Estimate:
    errors = one.errors
    changed = replace(
        errors,
        image_covariance=errors.image_covariance if image_covariance is None else image_covariance,
        shape_deviations=errors.shape_deviations if shape_deviations is None else shape_deviations,
        model_loadings=errors.model_loadings if model_loadings is None else model_loadings,
    )
    return replace(one, errors=changed)


def across_mm(x: float, y: float) -> NDArray[np.float64]:
    return np.array([0.0, 0.0, 0.0, x, y, 0.0])


def told(images: tuple[Estimate, ...]) -> Reason | None:
    names = tuple(f"{k + 1}" for k in range(len(images)))
    return disagreement(fuse(images), images, names, replace(rendered_parts(), nail=nail_part()), NAIL_POSE)

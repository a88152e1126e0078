"""How the robot's head really holds the guide: robot-world and hand-eye calibration by least squares. Pure.

Something that does not move with the robot (the ring on a C-arm that stays where it is, or the nail in the bone that
the robot stands on) is seen together with the guide in several poses of the platform:

    fixed_from_guide(i) = fixed_from_base @ base_from_top(i) @ top_from_guide

The two outer transforms of the right-hand side are not known and the same for all poses. Both are found at once from
all images, each weighted by its covariance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from distalock.guide_calibration.noise import robot_covariance
from shared.geometry.frames import Guide, RobotTop
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top
from shared.geometry.lines import read_only
from shared.geometry.transform import Transform

# Three views determine both transforms; one more shows whether they agree.
LEAST_VIEWS = 4
_UNKNOWNS = 12
# Of central differences in rad and mm: half of the digits of a double.
_DIFFERENCE = 1e-6
# A start is recognised as good or bad after eight steps; a hundred bound the rest.
_FIRST_STEPS, _MOST_STEPS = 8, 100
_LEAST_INFORMATION = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class GuideView:
    """The guide as seen in one pose of the platform.

    Attributes
    ----------
    pose
        Pose that the controller reported.
    fixed_from_guide
        The guide in the frame of what does not move (a matrix of shape (4, 4)).
    covariance
        Shape (6, 6), of a small rotation (rad) and translation (mm) in the guide's own frame.
    """

    pose: PlatformPose
    fixed_from_guide: NDArray[np.float64]
    covariance: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.fixed_from_guide.shape != (4, 4) or self.covariance.shape != (6, 6):
            raise ValueError(
                "expected a matrix of shape (4, 4) and a covariance of shape (6, 6), got "
                f"{self.fixed_from_guide.shape} and {self.covariance.shape}"
            )
        object.__setattr__(self, "fixed_from_guide", read_only(self.fixed_from_guide))
        object.__setattr__(self, "covariance", read_only(self.covariance))


@dataclass(frozen=True, slots=True, eq=False)
class GuideCalibration:
    """How the head holds the guide, estimated from several views.

    Attributes
    ----------
    top_from_guide
        At the head's extension of the images.
    covariance
        Of `top_from_guide`, shape (6, 6): a small rotation (rad) and translation (mm) in the guide's own frame. When
        the views agree worse than their own covariances allow, it is widened accordingly.
    fixed_from_base
        A matrix of shape (4, 4).
    normalised_rms
        Of the residuals over their standard deviations: 1 when the views agree as well as they should.
    """

    top_from_guide: Transform[RobotTop, Guide]
    covariance: NDArray[np.float64]
    fixed_from_base: NDArray[np.float64]
    normalised_rms: float

    @property
    def translation_sd_mm(self) -> float:
        """Predicted rms error of the guide's place."""
        return float(np.sqrt(np.trace(self.covariance[3:, 3:])))

    @property
    def rotation_sd_deg(self) -> float:
        """Predicted rms error of the guide's direction."""
        return float(np.degrees(np.sqrt(np.trace(self.covariance[:3, :3]))))


def calibrate_guide(
    hexapod: HexapodPart, views: Sequence[GuideView], nominal: Transform[RobotTop, Guide]
) -> GuideCalibration:
    """Find how the guide is held.

    Parameters
    ----------
    nominal
        What is expected; the guide may be on turned by quarter and half turns all the same.

    Raises
    ------
    ValueError
        With fewer than four views.
    """
    if len(views) < LEAST_VIEWS:
        raise ValueError(f"the guide was seen in {len(views)} poses, {LEAST_VIEWS} are needed; take more images")
    problem = _Problem.of(hexapod, views)
    tried = [problem.solved(nominal.rigid * turn, _FIRST_STEPS) for turn in _starts()]
    _, start, _ = min(tried, key=lambda solution: solution[0])
    cost, hand, world = problem.solved(start, _MOST_STEPS)
    degrees_of_freedom = 6 * len(views) - _UNKNOWNS
    scale = max(1.0, 2.0 * cost / degrees_of_freedom)
    covariance = scale * _inverse(problem.derivatives(hand, world))[:6, :6]
    return GuideCalibration(
        Transform(hand),
        read_only(np.asarray(covariance, dtype=np.float64)),
        read_only(np.asarray(world.as_matrix(), dtype=np.float64)),
        float(np.sqrt(2.0 * cost / degrees_of_freedom)),
    )


def view_residual(hexapod: HexapodPart, calibration: GuideCalibration, view: GuideView) -> tuple[float, float]:
    """How far a view is from what a calibration predicts: distance (mm) of the guide's origin, and angle (degrees)."""
    platform = base_from_top(hexapod, view.pose, hexapod.pivot_mm).rigid
    world = RigidTransform.from_matrix(calibration.fixed_from_base)
    predicted = world * platform * calibration.top_from_guide.rigid
    off = predicted.inv() * RigidTransform.from_matrix(view.fixed_from_guide)
    return float(np.linalg.norm(off.translation)), float(np.degrees(off.rotation.magnitude()))


def moved(transform: RigidTransform, step: NDArray[np.float64]) -> RigidTransform:
    """A transform after a small rotation (rad) and translation (mm) in its own frame, shape (6,)."""
    return transform * RigidTransform.from_components(step[3:], Rotation.from_rotvec(step[:3]))


def _starts() -> list[RigidTransform]:
    turns = [[0, 0, 0], [180, 0, 0], [0, 180, 0], [0, 0, 180], [0, 0, 90], [0, 0, -90]]
    return [RigidTransform.from_rotation(Rotation.from_rotvec(np.radians(turn))) for turn in turns]


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """Platforms and what was seen (N transforms each), and what makes residuals of unit variance, shape (N, 6, 6)."""

    platforms: RigidTransform
    seen: RigidTransform
    whitening: NDArray[np.float64]

    @staticmethod
    def of(hexapod: HexapodPart, views: Sequence[GuideView]) -> "_Problem":
        noise = np.array([view.covariance + robot_covariance() for view in views])
        return _Problem(
            RigidTransform.from_matrix(
                np.array([base_from_top(hexapod, view.pose, hexapod.pivot_mm).matrix for view in views])
            ),
            RigidTransform.from_matrix(np.array([view.fixed_from_guide for view in views])),
            np.linalg.inv(np.linalg.cholesky(noise)),
        )

    def solved(self, start: RigidTransform, most_steps: int) -> tuple[float, RigidTransform, RigidTransform]:
        """Cost, hand-eye and robot-world at the optimum that is reached from a start, or on the way there."""
        world = self.seen[0] * (self.platforms[0] * start).inv()

        def residuals(steps: NDArray[np.float64]) -> NDArray[np.float64]:
            return self._residuals(moved(start, steps[:6]), moved(world, steps[6:]))

        found = least_squares(residuals, np.zeros(_UNKNOWNS), x_scale="jac", max_nfev=most_steps)
        return float(found.cost), moved(start, found.x[:6]), moved(world, found.x[6:])

    def derivatives(self, hand: RigidTransform, world: RigidTransform) -> NDArray[np.float64]:
        """Of the residuals by steps in the frames of both transforms, shape (6 N, 12)."""
        columns = []
        for step in _DIFFERENCE * np.eye(_UNKNOWNS):
            ends = [self._residuals(moved(hand, s[:6]), moved(world, s[6:])) for s in (step, -step)]
            columns.append((ends[0] - ends[1]) / (2.0 * _DIFFERENCE))
        return np.stack(columns, axis=-1)

    def _residuals(self, hand: RigidTransform, world: RigidTransform) -> NDArray[np.float64]:
        off = (world * self.platforms * hand).inv() * self.seen
        steps = np.concatenate([off.rotation.as_rotvec(), off.translation], axis=-1)
        return np.asarray(np.einsum("nij,nj->ni", self.whitening, steps).ravel())


def _inverse(jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse of J'J; what the views leave open gets a variance of 10^4 and not infinity."""
    values, vectors = np.linalg.eigh(jacobian.T @ jacobian)
    return np.asarray(vectors / np.maximum(values, _LEAST_INFORMATION) @ vectors.T)

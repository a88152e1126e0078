"""Bodies of the control API that report the truth: for tests and demonstrations only."""

from typing import Literal

from simulation.control.models import Body, CArmBody, Vector, c_arm_body, vector
from simulation.controller.virtual_controller import Snapshot
from simulation.render.truth import (
    AxisError,
    BallTruth,
    HoleTruth,
    ImageTruth,
    guide_axis_errors,
    hole_truths,
    wire_errors,
)
from simulation.room.operating_room import OperatingRoom

Matrix = list[list[float]]


class ControllerBody(Body):
    """The hexapod as it is. Times are those of `clock_s`: the monotonic clock of this host.

    `pose` is X Y Z in mm, U V W in degrees. `at_rest_since_s` is null while the platform moves, `locked_since_s` while
    the brake is off or the servo on. `was_unheld`: it was held by neither at some time.
    """

    clock_s: float
    pose: tuple[float, float, float, float, float, float]
    moving: bool
    servo_on: bool
    brake_on: bool
    was_unheld: bool
    at_rest_since_s: float | None
    locked_since_s: float | None


def controller_body(snapshot: Snapshot, clock_s: float) -> ControllerBody:
    """Describe the hexapod."""
    x, y, z, u, v, w = (float(value) for value in snapshot.pose.as_array())
    return ControllerBody(
        clock_s=clock_s,
        pose=(x, y, z, u, v, w),
        moving=snapshot.moving,
        servo_on=snapshot.servo_on,
        brake_on=snapshot.brake_on,
        was_unheld=snapshot.was_unheld,
        at_rest_since_s=snapshot.at_rest_since_s,
        locked_since_s=snapshot.locked_since_s,
    )


class AxisErrorBody(Body):
    """An axis against the nail hole's axis of the same id."""

    hole_id: str
    entry_offset_mm: float
    exit_offset_mm: float
    angle_deg: float


def axis_error_body(error: AxisError) -> AxisErrorBody:
    """Describe an axis' error."""
    return AxisErrorBody(
        hole_id=error.id,
        entry_offset_mm=error.entry_offset_mm,
        exit_offset_mm=error.exit_offset_mm,
        angle_deg=error.angle_deg,
    )


class HoleBody(Body):
    """A nail hole as `locate` should print it."""

    id: str
    entry_point_guide_mm: Vector
    axis_guide: Vector
    tilt_to_ray_deg: float


def hole_body(hole: HoleTruth) -> HoleBody:
    """Describe a hole."""
    return HoleBody(
        id=hole.id,
        entry_point_guide_mm=vector(hole.entry_point_guide_mm),
        axis_guide=vector(hole.axis_guide),
        tilt_to_ray_deg=hole.tilt_to_ray_deg,
    )


class BallBody(Body):
    """A ball in the image."""

    id: str
    image_px: tuple[float, float]
    undistorted_px: tuple[float, float]
    radius_px: float
    in_view: bool
    over_metal: bool
    touches_ball: bool


class ImageTruthBody(Body):
    """What is true about one image."""

    intrinsic_matrix_px: Matrix
    mirrored: bool
    camera_from_ring: Matrix
    camera_from_guide: Matrix | None
    camera_from_nail: Matrix | None
    guide_from_nail: Matrix
    holes: list[HoleBody]
    wires: list[AxisErrorBody]
    balls: list[BallBody]


def _ball_body(ball: BallTruth) -> BallBody:
    return BallBody(
        id=ball.id,
        image_px=ball.image_px,
        undistorted_px=ball.undistorted_px,
        radius_px=ball.radius_px,
        in_view=ball.in_view,
        over_metal=ball.over_metal,
        touches_ball=ball.touches_ball,
    )


def image_truth_body(truth: ImageTruth) -> ImageTruthBody:
    """Describe an image's truth."""
    return ImageTruthBody(
        intrinsic_matrix_px=truth.intrinsic_matrix_px.tolist(),
        mirrored=truth.mirrored,
        camera_from_ring=truth.camera_from_ring.matrix.tolist(),
        camera_from_guide=None if truth.camera_from_guide is None else truth.camera_from_guide.matrix.tolist(),
        camera_from_nail=None if truth.camera_from_nail is None else truth.camera_from_nail.matrix.tolist(),
        guide_from_nail=truth.guide_from_nail.matrix.tolist(),
        holes=[hole_body(h) for h in truth.holes],
        wires=[axis_error_body(w) for w in truth.wires],
        balls=[_ball_body(b) for b in truth.balls],
    )


class TruthBody(Body):
    """The room as it is: for tests and demonstrations only.

    `guide_errors` are the guide's holes against the nail's, as the platform stands now; `last_image` belongs to the
    last shot and is null before the first.
    """

    simulated: Literal[True] = True
    c_arm: CArmBody
    guide_from_nail: Matrix
    base_from_top: Matrix
    guide_errors: list[AxisErrorBody]
    holes: list[HoleBody]
    wires: list[AxisErrorBody]
    last_image: ImageTruthBody | None


def truth_body(room: OperatingRoom, last_image: ImageTruth | None) -> TruthBody:
    """Describe the room as it is now."""
    scenario, world = room.scenario, room.world()
    return TruthBody(
        c_arm=c_arm_body(world.state.angles),
        guide_from_nail=world.guide_from_nail.matrix.tolist(),
        base_from_top=world.state.platform.matrix.tolist(),
        guide_errors=[axis_error_body(e) for e in guide_axis_errors(scenario, world)],
        holes=[hole_body(h) for h in hole_truths(scenario, world)],
        wires=[axis_error_body(w) for w in wire_errors(scenario, world)],
        last_image=None if last_image is None else image_truth_body(last_image),
    )

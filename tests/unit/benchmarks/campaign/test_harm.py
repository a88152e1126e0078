"""What the campaign counts as harm is noticed where it happens, and nowhere else."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from benchmarks.campaign.harm import MotionWatch, harm_of
from benchmarks.campaign.rows import DrilledHole
from benchmarks.robot.rig import Rig
from shared.geometry.hexapod import PlatformPose
from simulation.controller.accuracy import seeded

RIGHT = DrilledHole("distal", 0.2, 0.3, passed=True, allowed=True, slipped=False)
TARGET = PlatformPose(1.0, 0.0, 0.5, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("hole", "harm"),
    [
        (RIGHT, ""),
        (replace(RIGHT, entry_mm=1.01), "wrong axis"),
        (replace(RIGHT, angle_deg=1.51), "wrong axis"),
        (replace(RIGHT, passed=False), "struck"),
        (replace(RIGHT, entry_mm=3.0, allowed=False), ""),
        (replace(RIGHT, entry_mm=3.0, slipped=True), ""),
    ],
)
def test_a_hole_that_the_system_allowed_must_be_right(hole: DrilledHole, harm: str) -> None:
    assert harm_of(hole).partition(":")[0] == harm


def _ready() -> tuple[Rig, MotionWatch]:
    rig = Rig(5, 0.1, seeded(5))
    rig.make_ready()
    return rig, MotionWatch(rig)


def _moved(change: Callable[[MotionWatch], None], ticks: int = 12) -> list[str]:
    """A motion that the robot accepts, on a watch that was told something else."""
    rig, watch = _ready()
    start = rig.state.pose
    assert start is not None
    assert rig.ask(rig.move(rig.publish_plan(TARGET))).verdict == "accepted"
    watch.permit((start.value(), TARGET))
    change(watch)
    for _ in range(ticks):
        watch.tick(0.1)
    rig.leave()
    return [harm.partition(":")[0] for harm in watch.harms]


def _forget_the_permit(watch: MotionWatch) -> None:
    watch.way = None


def _permit_another_way(watch: MotionWatch) -> None:
    watch.permit((PlatformPose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), PlatformPose(0.0, 3.0, 0.0, 0.0, 0.0, 0.0)))


def _put_a_wire_in(watch: MotionWatch) -> None:
    watch.inside = True


def _be_on_the_wrong_side(watch: MotionWatch) -> None:
    watch.wrong_side = True


@pytest.mark.parametrize(
    ("change", "harms"),
    [
        (lambda _: None, []),
        (_forget_the_permit, ["unpermitted motion"]),
        (_permit_another_way, ["off the way"]),
        (_put_a_wire_in, ["motion with something inside"]),
        (_be_on_the_wrong_side, ["wrong side"]),
        (MotionWatch.note_stop, ["motion after a stop"]),
    ],
)
def test_a_motion_is_held_against_what_was_permitted(change: Callable[[MotionWatch], None], harms: list[str]) -> None:
    assert _moved(change) == harms

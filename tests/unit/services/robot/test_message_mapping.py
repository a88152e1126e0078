"""What others learn of the robot."""

from services.robot.core.permits import PermitRecord
from services.robot.message_mapping import Publication, robot_state
from shared.robot_states import MotionState
from tests.unit.services.robot.drive_bench import Bench
from tests.unit.services.robot.room import HEXAPOD


def test_of_a_controller_that_was_slow_to_answer_nothing_is_reported_but_the_state(bench: Bench) -> None:
    """By this pattern gateway and registration know that nothing has changed (`RobotWatch`, `RegistrationState`)."""
    bench.make_ready()
    bench.controller.silent = True
    bench.now_s += 0.9
    bench.work(1)
    known = robot_state(bench.drive.status, HEXAPOD, Publication("robot-1", 1, None, PermitRecord()))
    assert known.state is MotionState.LOCKED
    assert (known.locked, known.referenced, known.pose) == (False, False, None)

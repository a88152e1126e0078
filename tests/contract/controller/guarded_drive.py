"""A robot service without a bus, to be killed: ``python -m tests.contract.controller.guarded_drive URL``.

Drive, driver and guardian are the product's. It makes the robot ready, begins to move, again
whenever a deadline stopped the move, and prints a line once it moves.
"""

import sys
import time

from services.robot.core.guard import PermittedMove
from services.robot.core.status import DriveStatus
from services.robot.core.tuning import CONTROLLER_LINE, SUPERVISION
from services.robot.devices.controller import Encoders, HexapodController
from services.robot.devices.gcs.controller import GcsController
from services.robot.devices.guardian import Guardian
from services.robot.devices.serial_port import open_port
from services.robot.drive.drive import Drive
from shared.geometry.hexapod import ZERO_POSE
from shared.robot_states import MotionState
from tests.contract.controller.lines import FAR, HEXAPOD, wait_until

RETRY_S = 0.1
SPEED_MM_PER_S = 2.0


def main(url: str) -> None:
    """Move until killed."""
    guardian = Guardian()

    def connect() -> HexapodController:
        port = open_port(url, 115200)
        return GcsController(port, HEXAPOD, Encoders.ABSOLUTE, CONTROLLER_LINE.reply_timeout_s, guardian)

    drive = Drive(connect, SUPERVISION.read_back, time.monotonic, RETRY_S, print, guardian=guardian)
    drive.start()
    wait_until(lambda: is_moving(drive))
    print("moving", flush=True)
    while True:
        time.sleep(60.0)


def is_moving(drive: Drive) -> bool:
    """Take the next step towards a motion; whether it is under way."""
    status = drive.status
    match status.state:
        case MotionState.FAULT:
            drive.reset()
        case MotionState.STOPPED:
            drive.acknowledge_stop()
        case MotionState.UNREFERENCED:
            drive.begin_reference("reference")
        case MotionState.LOCKED:
            drive.begin_move("move", permit)
        case _:
            pass
    feedback = status.feedback
    return status.state is MotionState.MOVING and feedback is not None and feedback.moving


def permit(status: DriveStatus) -> PermittedMove:
    """Three seconds' way: from wherever a busy machine, whose deadlines stop a move, left the robot."""
    start = ZERO_POSE if status.feedback is None else status.feedback.pose
    target = FAR if start.x_mm < FAR.x_mm / 2.0 else ZERO_POSE
    duration_s = abs(target.x_mm - start.x_mm) / SPEED_MM_PER_S
    return PermittedMove("a" * 64, start, target, SPEED_MM_PER_S, duration_s)


if __name__ == "__main__":
    main(sys.argv[1])

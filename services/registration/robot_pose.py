"""Where the robot stands, and whether that is where it stood before, as far as encoders can tell."""

from shared.messages.robot import MotionState, PlatformPoseMessage, RobotState

AT_REST = (MotionState.LOCKED, MotionState.STOPPED)
# A locked robot's encoders repeat to a micrometre; more than this means that it was moved.
POSE_TOLERANCE_MM = 0.01
POSE_TOLERANCE_DEG = 0.01


def pose_at_rest(robot: RobotState | None) -> PlatformPoseMessage | None:
    """Where the robot stands; None when that is not known or it is not at rest."""
    return robot.pose if robot is not None and robot.state in AT_REST else None


def moved_by(a: PlatformPoseMessage, b: PlatformPoseMessage) -> tuple[float, float]:
    """Greatest difference of two poses along an axis, in mm, and about one, in degrees."""
    apart_mm = max(abs(a.x_mm - b.x_mm), abs(a.y_mm - b.y_mm), abs(a.z_mm - b.z_mm))
    apart_deg = max(abs(a.u_deg - b.u_deg), abs(a.v_deg - b.v_deg), abs(a.w_deg - b.w_deg))
    return apart_mm, apart_deg


def same_place(a: PlatformPoseMessage, b: PlatformPoseMessage) -> bool:
    """Whether two poses are the same as far as encoders can tell."""
    apart_mm, apart_deg = moved_by(a, b)
    return apart_mm <= POSE_TOLERANCE_MM and apart_deg <= POSE_TOLERANCE_DEG

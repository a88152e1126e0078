"""The stable codes with which the robot service refuses a command; what each means stands in `refusals`."""

from enum import StrEnum


class RefusalCode(StrEnum):
    """Stable names of refusals: consoles, records and tests rely on them."""

    # The command itself (at most once, never late)
    MESSAGE_INVALID = "message_invalid"
    WRONG_BOOT_EPOCH = "wrong_boot_epoch"
    COMMAND_EXPIRED = "command_expired"
    STATE_NOT_PUBLISHED = "state_not_published"
    STOPPED_SINCE = "stopped_since"
    COMMAND_OUT_OF_ORDER = "command_out_of_order"
    COMMAND_ID_REUSED = "command_id_reused"
    OUTCOME_UNKNOWN = "outcome_unknown"

    # The motion table
    NOT_CONNECTED = "not_connected"
    STOP_IN_FORCE = "stop_in_force"
    STOP_BUTTON_PRESSED = "stop_button_pressed"
    NOT_REFERENCED = "not_referenced"
    BUSY = "busy"
    IN_FAULT = "in_fault"
    NOTHING_TO_DO = "nothing_to_do"

    # The permit
    PERMIT_MISSING = "permit_missing"
    PERMIT_ALTERED = "permit_altered"
    PERMIT_OF_ANOTHER_KEY = "permit_of_another_key"
    PERMIT_FORGED = "permit_forged"
    PERMIT_UNREADABLE = "permit_unreadable"
    PERMIT_FOR_ANOTHER_MOTION = "permit_for_another_motion"
    PERMIT_OF_ANOTHER_BOOT = "permit_of_another_boot"
    PERMIT_FOR_ANOTHER_HEXAPOD = "permit_for_another_hexapod"
    PERMIT_OF_ANOTHER_CASE = "permit_of_another_case"
    PERMIT_OF_ANOTHER_REVISION = "permit_of_another_revision"
    PERMIT_FOR_ANOTHER_PLAN = "permit_for_another_plan"
    PERMIT_FOR_OTHER_HOLES = "permit_for_other_holes"
    PERMIT_STATE_UNKNOWN = "permit_state_unknown"
    PERMIT_EXPIRED = "permit_expired"
    PERMIT_BEFORE_STOP = "permit_before_stop"
    PERMIT_USED = "permit_used"
    PERMIT_WITHOUT_CLEARANCE = "permit_without_clearance"
    SOMETHING_INSIDE = "something_inside"

    # The guard
    LINK_LOST = "link_lost"
    HEARTBEAT_MISSING = "heartbeat_missing"
    GUARDIAN_MISSING = "guardian_missing"
    POSE_UNKNOWN = "pose_unknown"
    NOT_LOCKED = "not_locked"
    PLAN_UNKNOWN = "plan_unknown"
    REGISTRATION_SILENT = "registration_silent"
    PLAN_STALE = "plan_stale"
    PLAN_EXPIRED = "plan_expired"
    PLAN_BEFORE_RECONNECTION = "plan_before_reconnection"
    PLAN_ALREADY_EXECUTED = "plan_already_executed"
    PLAN_OF_ANOTHER_CASE = "plan_of_another_case"
    PLAN_FOR_ANOTHER_ROBOT = "plan_for_another_robot"
    PIVOT_MISMATCH = "pivot_mismatch"
    START_POSE_DIFFERS = "start_pose_differs"
    TARGET_INCONSISTENT = "target_inconsistent"
    LEG_LENGTHS_INCONSISTENT = "leg_lengths_inconsistent"
    HEAD_EXTENSION = "head_extension"
    STEP_TOO_LARGE = "step_too_large"
    OUT_OF_REACH = "out_of_reach"

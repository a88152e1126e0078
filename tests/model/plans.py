"""The three plans that the model knows by what has become of them since they were made."""

from enum import StrEnum
from functools import cache

from services.robot.core.plans import PlannedMove
from services.robot.message_mapping import planned_move
from shared.geometry.frames import Guide
from shared.geometry.hexapod import ZERO_POSE, leg_lengths_mm
from shared.geometry.transform import Transform
from shared.messages.base import encode
from shared.messages.geometry import matrix4, vector3
from shared.messages.registration import Plan
from shared.messages.robot import PlatformPoseMessage
from shared.parts.files import sha256_of
from shared.parts.hexapod_file import default_hexapod
from tests.model.labels import CASE, EARLIER_BOOT, THIS_BOOT

HEXAPOD = default_hexapod()
REGISTRATION_EPOCH = "epoch-now"
IMAGE_SHA256 = "1" * 64
HOLES = ("distal",)


class PlanName(StrEnum):
    """A plan, by its relation to the present."""

    NONE = "no plan"
    CURRENT = "plan"
    OF_EARLIER_BOOT = "plan of an earlier boot"
    STALE = "stale plan"

    def after_restart(self) -> "PlanName":
        """After the robot service was started again."""
        return PlanName.OF_EARLIER_BOOT if self is PlanName.CURRENT else self


@cache
def plan_json(name: PlanName) -> bytes:
    """The plan, as registration publishes it: to where the robot stands already."""
    lengths = [float(v) for v in leg_lengths_mm(HEXAPOD, ZERO_POSE.as_array(), HEXAPOD.pivot_mm)]
    nothing: Transform[Guide, Guide] = Transform.identity()
    return encode(
        Plan(
            case_id=CASE,
            case_revision=1,
            image_sha256=IMAGE_SHA256,
            registration_epoch="epoch-before" if name is PlanName.STALE else REGISTRATION_EPOCH,
            robot_boot_epoch=EARLIER_BOOT if name is PlanName.OF_EARLIER_BOOT else THIS_BOOT,
            hexapod_sha256=HEXAPOD.sha256,
            hole_ids=HOLES,
            head_extension_mm=60.0,
            guide_from_target_guide=matrix4(nothing),
            start_pose=PlatformPoseMessage.of(ZERO_POSE),
            target_pose=PlatformPoseMessage.of(ZERO_POSE),
            pivot_mm=vector3(HEXAPOD.pivot_mm),
            target_leg_lengths_mm=(lengths[0], lengths[1], lengths[2], lengths[3], lengths[4], lengths[5]),
            travel_mm=0.0,
            travel_deg=0.0,
            axial_shift_mm=0.0,
            predicted=(),
        )
    )


@cache
def sha256(name: PlanName) -> str:
    """The plan's hash."""
    return sha256_of(plan_json(name))


@cache
def planned(name: PlanName) -> PlannedMove:
    """The plan as the robot service understands it."""
    return planned_move(plan_json(name))


def plan_of(sha: str) -> PlanName:
    """The plan with a hash."""
    return next(name for name in PlanName if name is not PlanName.NONE and sha256(name) == sha)

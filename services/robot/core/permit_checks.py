"""Whether a permit allows the motion that is asked for: one table of rules, each with its own refusal. Pure.

The signature comes first: nothing that is not the gateway's own word is read. The rest compares the permit with what
the robot itself knows.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from services.robot.core.permits import (
    Permit,
    PermitContext,
    SignatureFailure,
    has_expired,
)
from services.robot.core.refusals import Refusal, RefusalCode, refusal
from services.robot.core.tuning import PERMITS

# What is wrong, as "<observation>"; None when the rule is kept.
Violation = Callable[[Permit, PermitContext], str | None]


@dataclass(frozen=True, slots=True)
class PermitRule:
    """One thing that a permit must agree with, and the code with which it is refused otherwise."""

    code: RefusalCode
    violation: Violation


SIGNATURE_REFUSALS: Final[Mapping[SignatureFailure, tuple[RefusalCode, str]]] = {
    SignatureFailure.MISSING: (RefusalCode.PERMIT_MISSING, "the command carries no permit"),
    SignatureFailure.ALTERED: (RefusalCode.PERMIT_ALTERED, "the permit is not the text whose hash came with it"),
    SignatureFailure.OTHER_KEY: (
        RefusalCode.PERMIT_OF_ANOTHER_KEY,
        "the permit names another key than the gateway's, which this robot service was started with",
    ),
    SignatureFailure.FORGED: (RefusalCode.PERMIT_FORGED, "the permit's signature is not the gateway's over this text"),
    SignatureFailure.UNREADABLE: (
        RefusalCode.PERMIT_UNREADABLE,
        "the gateway signed the permit, but it is not of format version 1",
    ),
}


def check_permit(presented: Permit | SignatureFailure, now: PermitContext) -> Permit | Refusal:
    """The permit when it allows the motion now, or the first reason why it does not."""
    if isinstance(presented, SignatureFailure):
        return refusal(*SIGNATURE_REFUSALS[presented])
    for rule in RULES:
        observation = rule.violation(presented, now)
        if observation is not None:
            return refusal(rule.code, observation)
    return presented


def _another_motion(permit: Permit, now: PermitContext) -> str | None:
    if permit.motion is now.asked.motion:
        return None
    return f"the permit allows a {permit.motion}, the command asks for a {now.asked.motion}"


def _another_boot(permit: Permit, now: PermitContext) -> str | None:
    if permit.robot_boot_epoch == now.boot_epoch:
        return None
    return f"the permit is for boot '{permit.robot_boot_epoch}' of the robot service, this is boot '{now.boot_epoch}'"


def _another_hexapod(permit: Permit, now: PermitContext) -> str | None:
    if permit.hexapod_sha256 in (None, now.hexapod_sha256):
        return None
    return f"the permit is for hexapod {permit.hexapod_sha256[:12]}, this robot is {now.hexapod_sha256[:12]}"


def _another_case(permit: Permit, now: PermitContext) -> str | None:
    if now.case is None:
        return "the gateway has not published which case is open"
    if permit.case_id == now.case[0]:
        return None
    return f"the permit is for {_case(permit.case_id)}, open is {_case(now.case[0])}"


def _another_revision(permit: Permit, now: PermitContext) -> str | None:
    if now.case is None or permit.case_revision == now.case[1]:
        return None
    return f"the permit is for revision {permit.case_revision} of the case, the newest is {now.case[1]}"


def _another_plan(permit: Permit, now: PermitContext) -> str | None:
    if permit.plan_sha256 == now.asked.plan_sha256:
        return None
    return f"the permit is for plan {_plan(permit.plan_sha256)}, asked for is plan {_plan(now.asked.plan_sha256)}"


def _other_holes(permit: Permit, now: PermitContext) -> str | None:
    if now.asked.hole_ids is None or permit.hole_ids == now.asked.hole_ids:
        return None
    return f"the permit is for holes {_holes(permit.hole_ids)}, the plan for holes {_holes(now.asked.hole_ids)}"


def _state_unknown(permit: Permit, now: PermitContext) -> str | None:
    if now.newest_state is not None and permit.after_state_sequence <= now.newest_state:
        return None
    return f"the permit quotes state {permit.after_state_sequence}, which the robot has not published"


def _expired(permit: Permit, now: PermitContext) -> str | None:
    published_s = now.quoted_published_s
    if published_s is not None and not has_expired(published_s, now.now_s):
        return None
    age = "is out of record" if published_s is None else f"is {now.now_s - published_s:.2f} s old"
    return f"the permit quotes state {permit.after_state_sequence}, which {age}, the limit is {PERMITS.lifetime_s:g} s"


def _before_stop(permit: Permit, now: PermitContext) -> str | None:
    if permit.after_state_sequence >= now.first_since_stop:
        return None
    return f"the permit quotes state {permit.after_state_sequence}, and a stop has come since"


def _used(permit: Permit, now: PermitContext) -> str | None:
    return f"permit {permit.nonce[:12]} was used before, it allows one motion" if now.used.holds(permit.nonce) else None


def _without_clearance(permit: Permit, now: PermitContext) -> str | None:  # noqa: ARG001 - a rule's signature
    return None if permit.nothing_inside else "the permit does not say that nothing is in the guide and the bone"


def _something_inside(permit: Permit, now: PermitContext) -> str | None:  # noqa: ARG001 - likewise
    return f"the case says: {', '.join(now.inside)}" if now.inside else None


RULES: Final[tuple[PermitRule, ...]] = (
    PermitRule(RefusalCode.PERMIT_FOR_ANOTHER_MOTION, _another_motion),
    PermitRule(RefusalCode.PERMIT_OF_ANOTHER_BOOT, _another_boot),
    PermitRule(RefusalCode.PERMIT_FOR_ANOTHER_HEXAPOD, _another_hexapod),
    PermitRule(RefusalCode.PERMIT_OF_ANOTHER_CASE, _another_case),
    PermitRule(RefusalCode.PERMIT_OF_ANOTHER_REVISION, _another_revision),
    PermitRule(RefusalCode.PERMIT_FOR_ANOTHER_PLAN, _another_plan),
    PermitRule(RefusalCode.PERMIT_FOR_OTHER_HOLES, _other_holes),
    PermitRule(RefusalCode.PERMIT_STATE_UNKNOWN, _state_unknown),
    PermitRule(RefusalCode.PERMIT_EXPIRED, _expired),
    PermitRule(RefusalCode.PERMIT_BEFORE_STOP, _before_stop),
    PermitRule(RefusalCode.PERMIT_USED, _used),
    PermitRule(RefusalCode.PERMIT_WITHOUT_CLEARANCE, _without_clearance),
    PermitRule(RefusalCode.SOMETHING_INSIDE, _something_inside),
)


def _case(case_id: str | None) -> str:
    return "no case" if case_id is None else f"case '{case_id}'"


def _plan(sha256: str | None) -> str:
    return "none" if sha256 is None else sha256[:12]


def _holes(hole_ids: tuple[str, ...]) -> str:
    return ", ".join(hole_ids) or "none"

"""Attacks with the gateway's stolen key on permits: claimed, altered, forged, for something else, late, used before.

What the attacker changes is the one thing that is wrong: the same permit without the change would move the robot.
"""

import hashlib
import secrets
import time
import uuid
from collections.abc import Callable
from typing import Final

from cryptography.hazmat.primitives.asymmetric import ed25519

from shared.messages.base import decode, encode
from shared.messages.permits import Permit, SignedPermit
from shared.messages.registration import Plan
from shared.messages.robot import Approval, MoveCommand, MoveCommand1, PlainCommand
from shared.pki.permit_key import PERMIT_KEY_FILE, PermitSigner
from tests.attacks.commands import Thief, as_thief
from tests.attacks.site import Site, wait_until

ANOTHER_SHA256: Final = "0" * 64
LONGER_THAN_A_PERMIT_LASTS_S: Final = 2.5


def _good(thief: Thief, **changes: object) -> Permit:
    """The permit that the gateway would sign now for the approved plan, but for the changes."""
    case = thief.site.rest.get(f"/api/v1/cases/{thief.site.case.id}")
    content: dict[str, object] = {
        "motion": "move",
        "plan_sha256": thief.site.plan.sha256,
        "hole_ids": thief.site.hole_ids,
        "case_id": thief.site.case.id,
        "case_revision": case["revision"],
        "robot_boot_epoch": thief.state.boot_epoch,
        "after_state_sequence": thief.site.robot_state(thief.bus).sequence,
        "approver": "surgeon",
        "nothing_inside": True,
        "nonce": uuid.uuid4().hex,
    }
    return Permit.model_validate(content | changes)


def _signer(site: Site) -> PermitSigner:
    return PermitSigner.from_file(site.keystore.folder_of("ui_api") / PERMIT_KEY_FILE)


def _ask(thief: Thief, permit: SignedPermit, plan_sha256: str = "") -> str:
    """Ask for the approved move, or for another plan's, under a permit."""
    command = MoveCommand(envelope=thief.envelope(), plan_sha256=plan_sha256 or thief.site.plan.sha256, permit=permit)
    return thief.ask("move", encode(command))


def permit_with(**changes: object) -> Callable[[Site], str]:
    """A permit with the gateway's own signature that allows something else."""
    return as_thief(lambda thief: _ask(thief, _signer(thief.site).sign(_good(thief, **changes))))


def claimed(thief: Thief) -> str:
    """A move as before permits: with a plan, and the claim that it was approved."""
    approval = Approval(plan_sha256=thief.site.plan.sha256, approved_by="surgeon", approved_at_ns=time.time_ns())
    command = MoveCommand1(envelope=thief.envelope(), plan_json="{}", approval=approval)
    return thief.ask("move", encode(command))


def altered(thief: Thief) -> str:
    signed = _signer(thief.site).sign(_good(thief))
    return _ask(thief, signed.model_copy(update={"permit_json": signed.permit_json.replace("surgeon", "nobody")}))


def forged(thief: Thief) -> str:
    signed = _signer(thief.site).sign(_good(thief))
    return _ask(thief, signed.model_copy(update={"signature": secrets.token_hex(64)}))


def rewritten(thief: Thief) -> str:
    """Another text with its own hash under the signature of the first."""
    signer = _signer(thief.site)
    other = encode(_good(thief, approver="nobody"))
    changes = {"permit_json": other.decode(), "permit_sha256": hashlib.sha256(other).hexdigest()}
    return _ask(thief, signer.sign(_good(thief)).model_copy(update=changes))


def of_another_key(thief: Thief) -> str:
    return _ask(thief, PermitSigner(ed25519.Ed25519PrivateKey.generate()).sign(_good(thief)))


def late(thief: Thief) -> str:
    signed = _signer(thief.site).sign(_good(thief))
    time.sleep(LONGER_THAN_A_PERMIT_LASTS_S)
    return _ask(thief, signed)


def twice(thief: Thief) -> str:
    """A permit that was taken, although the robot did not know its plan, does not come again."""
    signed = _signer(thief.site).sign(_good(thief, plan_sha256=ANOTHER_SHA256))
    first = _ask(thief, signed, ANOTHER_SHA256)
    return _ask(thief, signed, ANOTHER_SHA256) if first == "plan_unknown" else f"first {first}"


def unknown_plan(thief: Thief) -> str:
    signed = _signer(thief.site).sign(_good(thief, plan_sha256=ANOTHER_SHA256))
    return _ask(thief, signed, ANOTHER_SHA256)


def forged_plan(thief: Thief) -> str:
    """The approved plan with another target, published as registration and permitted as the gateway."""
    plan = _published_plan(thief)
    target = plan.target_pose.model_copy(update={"x_mm": plan.target_pose.x_mm + 2.0})
    forged = encode(plan.model_copy(update={"target_pose": target}))
    sha256 = hashlib.sha256(forged).hexdigest()
    with thief.site.open_as("registration") as registration:
        registration.publisher(thief.site.keys.plan).put(forged)
        time.sleep(0.2)
        return _ask(thief, _signer(thief.site).sign(_good(thief, plan_sha256=sha256)), sha256)


def _published_plan(thief: Thief) -> Plan:
    heard: list[Plan] = []
    with thief.site.open_as("robot") as robot:
        robot.subscribe_retained(thief.site.keys.plan, lambda sample: heard.append(decode(Plan, sample.payload)))
        wait_until(lambda: bool(heard), "the plan")
    return heard[-1]


def reference(thief: Thief) -> str:
    return thief.ask("reference", encode(PlainCommand(verb="reference", envelope=thief.envelope())))


def executed(thief: Thief) -> str:
    """The plan that has been carried out, with a new permit."""
    return _ask(thief, _signer(thief.site).sign(_good(thief)))


def wire(thief: Thief) -> str:
    """The permit says that nothing is inside, the case that a wire is."""
    case = thief.site.case
    case.record_step("wires_inserted", thief.site.hole_ids, "an attack is tried")
    try:
        return _ask(thief, _signer(thief.site).sign(_good(thief)))
    finally:
        case.record_step("wires_removed", thief.site.hole_ids, "an attack is over")

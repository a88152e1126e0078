"""Permits for rigs: what a gateway would sign."""

import itertools

from benchmarks.robot.plans import HOLE_IDS
from shared.messages.permits import Permit, SignedPermit
from shared.messages.robot import CommandEnvelope
from shared.pki.permit_key import PermitSigner

_numbers = itertools.count(1)


def permit_for(
    signer: PermitSigner, envelope: CommandEnvelope, case: tuple[str, int], plan_sha256: str | None
) -> SignedPermit:
    """A permit for the command with this envelope: to carry a plan out, or without one for a reference."""
    return signer.sign(
        Permit(
            motion="reference" if plan_sha256 is None else "move",
            plan_sha256=plan_sha256,
            hole_ids=() if plan_sha256 is None else HOLE_IDS,
            case_id=case[0],
            case_revision=case[1],
            robot_boot_epoch=envelope.robot_boot_epoch,
            after_state_sequence=envelope.after_state_sequence,
            approver="nobody",
            nothing_inside=True,
            nonce=f"{envelope.command_id}.{next(_numbers)}",
        )
    )

"""Permits as the model names them: what the gateway signed, what was forged, and how each travels."""

from dataclasses import dataclass, replace
from typing import Final, Literal

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from shared.messages.base import decode
from shared.messages.permits import Permit, SignedPermit
from shared.pki.permit_key import PermitSigner, PermitVerifier
from tests.model.labels import CASE, EARLIER_BOOT, Quote, QuoteChange, quote_of
from tests.model.plans import HOLES, PlanName, plan_of, sha256

_KEY: Final = Ed25519PrivateKey.from_private_bytes(b"g" * 32)
SIGNER: Final = PermitSigner(_KEY)
VERIFIER: Final = PermitVerifier(_KEY.public_key())
_FORGER: Final = PermitSigner(Ed25519PrivateKey.from_private_bytes(b"f" * 32))


@dataclass(frozen=True, slots=True, order=True)
class Permission:
    """A permit, by what of it decides anything.

    Attributes
    ----------
    nothing_inside
        Whether it says that nothing is in guide and bone.
    genuine
        Whether the gateway signed it.
    """

    nonce: str
    motion: Literal["move", "reference"]
    plan: PlanName
    boot: str
    quote: Quote
    nothing_inside: bool
    genuine: bool = True

    def aged(self, change: QuoteChange) -> "Permission":
        """After time has passed, or a stop has come; see `Packet.aged`."""
        return self if self.boot == EARLIER_BOOT else replace(self, quote=change(self.quote))

    def after_restart(self) -> "Permission":
        """After the robot service was started again."""
        return replace(self, plan=self.plan.after_restart(), boot=EARLIER_BOOT, quote=Quote.NEW)

    def signed(self) -> SignedPermit:
        """As it travels."""
        text = Permit(
            motion=self.motion,
            plan_sha256=None if self.plan is PlanName.NONE else sha256(self.plan),
            hole_ids=HOLES if self.motion == "move" else (),
            case_id=CASE,
            case_revision=1,
            robot_boot_epoch=self.boot,
            after_state_sequence=self.quote.sequence,
            approver="surgeon",
            nothing_inside=self.nothing_inside,
            nonce=self.nonce,
        )
        if self.genuine:
            return SIGNER.sign(text)
        return _FORGER.sign(text).model_copy(update={"key_sha256": SIGNER.key_sha256})


def permission(signed: SignedPermit, nonce: str) -> Permission:
    """What a permit of the gateway says, under the model's names."""
    permit = decode(Permit, signed.permit_json.encode())
    plan = PlanName.NONE if permit.plan_sha256 is None else plan_of(permit.plan_sha256)
    quote = quote_of(permit.after_state_sequence)
    return Permission(nonce, permit.motion, plan, permit.robot_boot_epoch, quote, permit.nothing_inside)

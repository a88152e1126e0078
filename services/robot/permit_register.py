"""Takes each permit once, refuses all others, and keeps both on record."""

from collections.abc import Callable
from dataclasses import replace

from services.robot import message_mapping
from services.robot.core.permit_checks import check_permit
from services.robot.core.permits import Permit, PermitContext, PermitRecord, SignatureFailure, UsedPermits
from services.robot.core.refusals import Refusal
from shared.messages.permits import SignedPermit
from shared.pki.permit_key import PermitVerifier

NotePermit = Callable[[Permit | Refusal, str], None]


class PermitRegister:
    """The permits of one run of the robot service. Not thread-safe: the caller holds a lock.

    Parameters
    ----------
    note
        Called with each permit that was taken or the reason why not, and the hash of its text ("" without one).
    """

    def __init__(self, verifier: PermitVerifier, note: NotePermit) -> None:
        self._verifier = verifier
        self._note = note
        self.used = UsedPermits()
        self.record = PermitRecord()

    def read(self, signed: SignedPermit | None) -> Permit | SignatureFailure:
        """The permit that came with a command, if the gateway signed it."""
        return message_mapping.presented_permit(signed, self._verifier)

    def take(
        self, signed: SignedPermit | None, presented: Permit | SignatureFailure, now: PermitContext
    ) -> Refusal | None:
        """Take a permit, or say why it allows nothing; one that was taken is used, whatever comes of the motion."""
        outcome = check_permit(presented, now)
        sha256 = "" if signed is None else signed.permit_sha256
        if isinstance(outcome, Refusal):
            self.record = replace(self.record, refused=self.record.refused + 1, refusal=outcome.code.value)
        else:
            assert now.quoted_published_s is not None  # or it had expired
            self.used = self.used.with_taken(outcome.nonce, now.quoted_published_s, now.now_s)
            self.record = replace(self.record, taken_sha256=sha256)
        self._note(outcome, sha256)
        return outcome if isinstance(outcome, Refusal) else None

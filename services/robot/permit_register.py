"""Takes each permit once, refuses all others, and keeps both on record."""

from collections.abc import Callable
from dataclasses import replace

from services.robot import message_mapping
from services.robot.core.envelope import CommandLedger
from services.robot.core.permit_checks import check_permit
from services.robot.core.permits import (
    AskedMotion,
    Permit,
    PermitContext,
    PermitRecord,
    SignatureFailure,
    UsedPermits,
)
from services.robot.core.plans import RegistrationView
from services.robot.core.refusals import Refusal
from shared.messages.permits import SignedPermit
from shared.pki.permit_key import PermitVerifier

NotePermit = Callable[[Permit | Refusal, str], None]


class PermitRegister:
    """The permits of one run of the robot service. Not thread-safe: the caller holds a lock.

    Parameters
    ----------
    ledger
        Knows which states were published, and when.
    note
        Called with each permit that was taken or the reason why not, and the hash of its text ("" without one).
    hexapod_sha256
        Of the hexapod that this service was started with.
    """

    def __init__(
        self,
        verifier: PermitVerifier,
        ledger: CommandLedger,
        clock_s: Callable[[], float],
        note: NotePermit,
        hexapod_sha256: str,
    ) -> None:
        self._hexapod_sha256 = hexapod_sha256
        self._verifier = verifier
        self._ledger = ledger
        self._clock_s = clock_s
        self._note = note
        self._used = UsedPermits()
        self.record = PermitRecord()

    def take(self, signed: SignedPermit | None, asked: AskedMotion, view: RegistrationView) -> Refusal | None:
        """Take a permit, or say why it allows nothing; one that was taken is used, whatever comes of the motion."""
        presented = message_mapping.presented_permit(signed, self._verifier)
        now = self._context(presented, asked, view)
        outcome = check_permit(presented, now)
        sha256 = "" if signed is None else signed.permit_sha256
        if isinstance(outcome, Refusal):
            self.record = replace(self.record, refused=self.record.refused + 1, refusal=outcome.code.value)
        else:
            assert now.quoted_published_s is not None  # or it had expired
            self._used = self._used.with_taken(outcome.nonce, now.quoted_published_s, now.now_s)
            self.record = replace(self.record, taken_sha256=sha256)
        self._note(outcome, sha256)
        return outcome if isinstance(outcome, Refusal) else None

    def _context(
        self, presented: Permit | SignatureFailure, asked: AskedMotion, view: RegistrationView
    ) -> PermitContext:
        quoted = presented.after_state_sequence if isinstance(presented, Permit) else None
        return PermitContext(
            asked=asked,
            boot_epoch=self._ledger.boot_epoch,
            hexapod_sha256=self._hexapod_sha256,
            now_s=self._clock_s(),
            case=view.case,
            inside=view.inside,
            newest_state=self._ledger.newest_state,
            first_since_stop=self._ledger.first_since_stop,
            quoted_published_s=None if quoted is None else self._ledger.published_s(quoted),
            used=self._used,
        )

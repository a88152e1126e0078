"""The C-arm of the campaign: images are taken, localised, and taken anew as advised."""

from dataclasses import dataclass
from typing import Final

from benchmarks.campaign.people import PAUSE_S, GaveUp, People
from services.ui_api.core.event_data import LocalisationReceived
from shared.errors import ReasonCode
from shared.messages.base import decode
from shared.messages.registration import LocalisationRecord

# Chosen, as in `distalock.procedure`: what people try before they go on by hand.
MOST_SHOTS: Final = 4
_ANOTHER_VIEW_DEG: Final = (2.0, 1.5)


@dataclass(frozen=True, slots=True)
class CArmOperator:
    """Takes images until one is accepted, and turns the C-arm as advised."""

    people: People

    def shot(self) -> LocalisationReceived | None:
        """Take an image, and hear what is found in it."""
        self.people.wait(PAUSE_S)
        pixels, nominal = self.people.room.shoot()
        sha256 = self.people.system.receive(
            pixels, self.people.scenario.parts.ring, nominal, self.people.scenario.side, self.people.room.angles
        )
        self.people.slipped = False  # what moved until now is in this image
        found = self.people.case.localisation_of(sha256)
        for code in () if found is None or found.verdict == "accepted" else found.reason_codes:
            self.people.note(code, self._sentence_of(found, code))
        return found

    def _sentence_of(self, found: LocalisationReceived | None, code: str) -> str:
        if found is None:
            return ""
        reasons = self._document(found).localisation.reasons
        return next((reason.message for reason in reasons if reason.code == code), "")

    def _document(self, found: LocalisationReceived) -> LocalisationRecord:
        return decode(LocalisationRecord, self.people.system.record.document(found.document_sha256))

    def localise(self) -> LocalisationReceived:
        """Take images until one is accepted; turn the C-arm as advised, take away what lies there."""
        for _ in range(MOST_SHOTS):
            found = self.shot()
            if found is not None and found.verdict == "accepted":
                return found
            self.people.mend_if_named(() if found is None else found.reason_codes)
            self.people.room.cluttered = False
            self._turn(found)
        raise GaveUp(self.people.last())

    def _turn(self, found: LocalisationReceived | None) -> None:
        turn = None if found is None else self._document(found).localisation.c_arm_correction_deg
        if found is not None and turn is not None and ReasonCode.TILT_TOO_LARGE.value in found.reason_codes:
            self.people.room.turn_c_arm(turn.about_image_x, turn.about_image_y)
        else:
            self.people.room.turn_c_arm(*_ANOTHER_VIEW_DEG)

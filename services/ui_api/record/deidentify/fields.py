"""Fields of events and documents without what identifies people."""

from dataclasses import dataclass
from typing import Final

from services.ui_api.record.deidentify.pseudonyms import SHA256, Pseudonyms
from services.ui_api.record.deidentify.table import RECORD_RULES, Action, names_of
from services.ui_api.record.export.content import Json

_KEPT: Final = names_of(RECORD_RULES, Action.KEEP)
_PEOPLE: Final = names_of(RECORD_RULES, Action.PERSON)
_NAMED: Final = names_of(RECORD_RULES, Action.PSEUDONYM)
_UIDS: Final = names_of(RECORD_RULES, Action.REPLACE_UID)
_OF_THE_CHAIN: Final = frozenset({"sha256", "previous_sha256"})
REMOVED: Final = ""
# Chosen: above the length of any procedure; what lies farther apart is no interval.
_LONGEST_NS: Final = 30 * 24 * 3600 * 10**9


@dataclass(frozen=True, slots=True)
class FieldCleaner:
    """Applies the table to JSON values.

    Attributes
    ----------
    opened_at_ns
        When the case was opened: times count from then.
    """

    pseudonyms: Pseudonyms
    opened_at_ns: int

    def event(self, event: Json) -> Json:
        """An event; its hashes belong to the chain, which is not handed over."""
        cleaned = {key: self.value(key, value) for key, value in event.items() if key not in _OF_THE_CHAIN}
        elapsed_ns = cleaned["at_ns"]
        return cleaned | {"at": f"{elapsed_ns / 1e9:.3f} s" if isinstance(elapsed_ns, int) else REMOVED}

    def value(self, key: str, value: object) -> object:
        """A value under a key; items of a list count as under the list's key."""
        match value:
            case dict():
                return {name: self.value(str(name), inner) for name, inner in value.items()}
            case list():
                return [self.value(key, inner) for inner in value]
            case str():
                return self._text(key, value)
            case int() if key.endswith("at_ns") and not isinstance(value, bool):
                return self._elapsed(value)
            case _:
                return value

    def _elapsed(self, at_ns: int) -> int | None:
        """From a clock that was never set (1970) the opening's date could be found."""
        elapsed_ns = at_ns - self.opened_at_ns
        return elapsed_ns if abs(elapsed_ns) < _LONGEST_NS else None

    def _text(self, key: str, text: str) -> str:
        if SHA256.fullmatch(text):
            return self.pseudonyms.sha256(text)
        if key in _KEPT:
            return text
        if key in _PEOPLE:
            return self.pseudonyms.person(text)
        if key in _NAMED:
            return self.pseudonyms.name(text)
        return self.pseudonyms.uid(text) if key in _UIDS else REMOVED

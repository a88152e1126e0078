"""The case record as it is, on a database that keeps nothing and that can refuse to."""

import sqlite3
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Self

from services.ui_api.core.chain import GENESIS_SHA256
from services.ui_api.core.events import EventDraft
from services.ui_api.core.ledger import Ledger
from services.ui_api.record.record import CaseRecord
from tests.model.plans import plan_json, plan_of


class NoDatabase:
    """Takes statements and forgets them.

    Attributes
    ----------
    is_full
        Whether a transaction fails when it is to be written.
    """

    def __init__(self) -> None:
        self.is_full = False

    def connect(self) -> Self:
        return self

    def execution_options(self, **_: object) -> Self:
        return self

    def execute(self, *_: object) -> Self:
        """Nothing is kept."""
        return self

    def first(self) -> Self:
        """Whatever is looked for is there."""
        return self

    @contextmanager
    def begin(self) -> Iterator[None]:
        yield
        if self.is_full:
            raise sqlite3.OperationalError("database or disk is full")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...


class MemoryRecord(CaseRecord):
    """`CaseRecord` with its own order of commit, ledger and what follows; documents are the model's plans."""

    def __init__(self) -> None:
        self.database = NoDatabase()
        self._engine = self.database  # type: ignore[assignment]  # the four methods that a transaction uses
        self._clock_ns = lambda: 0
        self.on_write = lambda _: None
        self._writer = threading.RLock()
        self._listeners = []
        self._head_sha256 = GENESIS_SHA256
        self._in_doubt = False
        self.ledger = Ledger()

    def document(self, sha256: str) -> bytes:
        """A plan, by its hash."""
        return plan_json(plan_of(sha256))

    def load(self, ledger: Ledger) -> None:
        """Begin anew with what the log adds up to; the database has room again."""
        self.ledger, self.database.is_full, self._in_doubt = ledger, False, False

    def note(self, drafts: Sequence[EventDraft]) -> None:
        """Events that come from elsewhere than the handlers of the model."""
        with self.write() as unit:
            for draft in drafts:
                unit.append(draft)

"""Processes that write into a record and kill themselves at one write point after the other: a program of its own.

usage: python -m tests.unit.services.ui_api.record.killed_writers URL
"""

import itertools
import os
import signal
import sys
import time

from sqlalchemy import event

from services.ui_api.core.chain import ChainIntact
from services.ui_api.core.event_data import GatewayStarted
from services.ui_api.core.events import EventDraft
from services.ui_api.record.database import existing_database, open_database
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import Answer
from services.ui_api.record.verify import verify_record

_EVENT = EventDraft(GatewayStarted("epoch", "version"), None, "writer")


def _write_until(url: str, point: int, acknowledge: int) -> None:
    """Write one unit of work, and another when the first was acknowledged; die at the given point of the second."""
    engine = open_database(url)
    record = CaseRecord(engine, time.time_ns)
    passed = itertools.count()

    def reach(*_: object) -> None:
        if next(passed) == point:
            os.kill(os.getpid(), signal.SIGKILL)

    record.append(_EVENT)
    os.write(acknowledge, b".")
    event.listen(engine, "before_cursor_execute", reach)
    event.listen(engine, "commit", reach)
    with record.write() as unit:
        unit.append(_EVENT)
        unit.put_document(f"{time.time_ns()}".encode())
        unit.append(_EVENT)
        unit.remember(f"of-the-killed-{point}", "a" * 64, Answer(201, "{}", {}))
        unit.after_commit(reach)
    os.write(acknowledge, b"..")


def main(url: str) -> int:
    """One line for each point: how the process ended, and what was found; 1 when something was lost."""
    open_database(url).dispose()
    acknowledged = 0
    for point in itertools.count():
        reading, writing = os.pipe()
        child = os.fork()  # this program has one thread
        if child == 0:
            _write_until(url, point, writing)
            os._exit(0)
        os.close(writing)
        _, status = os.waitpid(child, 0)
        acknowledged += len(os.read(reading, 16))
        os.close(reading)
        engine = existing_database(url)
        verdict = verify_record(engine)
        engine.dispose()
        entries = verdict.entries if isinstance(verdict, ChainIntact) else -1
        ended = "killed" if os.WIFSIGNALED(status) else "ended"
        finding = "intact" if entries >= acknowledged else f"{acknowledged} acknowledged, {verdict}"
        sys.stdout.write(f"point {point}: {ended}, {finding}\n")
        if entries < acknowledged or ended == "ended":
            return 0 if entries >= acknowledged and os.waitstatus_to_exitcode(status) == 0 else 1
        acknowledged = entries
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

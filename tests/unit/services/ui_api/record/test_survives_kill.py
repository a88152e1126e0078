"""Kill -9 at any point of writing loses no acknowledged event, and the record goes on."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from services.ui_api.core.chain import ChainIntact
from services.ui_api.record.database import existing_database, open_database, sqlite_url
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.verify import verify_record
from tests.unit.services.ui_api.room import open_room
from tests.unit.services.ui_api.routes.test_procedure_over_rest import (
    test_a_case_runs_from_opening_to_finish as run_a_case,
)

_WRITER = """
import sys, time
from pathlib import Path
from services.ui_api.core.event_data import GatewayStarted
from services.ui_api.core.events import EventDraft
from services.ui_api.record.database import open_database, sqlite_url
from services.ui_api.record.record import CaseRecord

record = CaseRecord(open_database(sqlite_url(Path(sys.argv[1]))), time.time_ns)
while True:
    record.append(EventDraft(GatewayStarted("epoch", "version"), None, "writer"))
    print(record.ledger.head_sequence, flush=True)
"""


@pytest.mark.requirement("GW-06")
@pytest.mark.parametrize("acknowledged", [1, 40])
def test_a_killed_writer_leaves_every_acknowledged_event(tmp_path: Path, acknowledged: int) -> None:
    with subprocess.Popen([sys.executable, "-c", _WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        last = 0
        while last < acknowledged:
            last = int(writer.stdout.readline())
        os.kill(writer.pid, signal.SIGKILL)
        for line in writer.stdout:
            last = int(line) if line.endswith("\n") else last
        assert writer.wait() == -signal.SIGKILL
    verdict = verify_record(existing_database(sqlite_url(tmp_path)))
    assert isinstance(verdict, ChainIntact)
    assert verdict.entries >= last
    again = CaseRecord(open_database(sqlite_url(tmp_path)), lambda: 0)
    assert again.ledger.head_sequence == verdict.entries


def test_a_writer_killed_at_each_write_point_leaves_every_acknowledged_event(record_url: str, tmp_path: Path) -> None:
    """Before each statement, before and after the commit: one process after the other on one record, then a gateway."""
    program = ["-m", "tests.unit.services.ui_api.record.killed_writers", record_url]
    run = subprocess.run([sys.executable, *program], check=False, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()
    assert len(lines) >= 8, "a unit of work has so many points"
    assert all(line.endswith(("killed, intact", "ended, intact")) for line in lines), run.stdout
    assert lines[-1].endswith("ended, intact"), "the last one came through all points"
    with open_room(tmp_path, database_url=record_url) as room:
        run_a_case(room)
    engine = existing_database(record_url)
    assert isinstance(verify_record(engine), ChainIntact)
    engine.dispose()

"""A whole gateway on PostgreSQL: what the tests over HTTP show on SQLite holds there too."""

from pathlib import Path

from services.ui_api.core.chain import ChainIntact
from services.ui_api.record.database import existing_database
from services.ui_api.record.verify import verify_record
from tests.postgresql import Server
from tests.unit.services.ui_api.room import open_room
from tests.unit.services.ui_api.routes.test_procedure_over_rest import (
    test_a_case_runs_from_opening_to_finish as run_a_case,
)


def test_a_case_runs_and_is_there_after_a_restart(tmp_path: Path, postgresql: Server, migrated: str) -> None:
    url = postgresql.url(postgresql.make_database(migrated))
    with open_room(tmp_path, database_url=url) as room:
        run_a_case(room)
        (case,) = room.gateway.record.ledger.cases.values()
    with open_room(tmp_path, database_url=url) as room:
        assert room.gateway.record.ledger.cases == {case.case_id: case}
        assert room.get(f"/cases/{case.case_id}").json()["procedure"]["stage"] == "finished"
        room.open_case()
    engine = existing_database(url)
    assert isinstance(verify_record(engine), ChainIntact)
    engine.dispose()
    assert not list(tmp_path.glob("*.sqlite"))

"""A record of every earlier revision, with something in it, becomes one of this version while somebody reads it."""

from pathlib import Path

import pytest
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, text
from sqlalchemy.exc import IntegrityError

from services.ui_api.core.chain import ChainIntact
from services.ui_api.record.database import open_database, sqlite_url, upgrade
from services.ui_api.record.engines import engine_of
from services.ui_api.record.unit_of_work import Answer
from services.ui_api.record.verify import verify_record
from tests.postgresql import Server
from tests.unit.services.ui_api.record.filled import STEP, fill, record_of


def _revisions() -> list[str]:
    """All but the newest, the oldest first."""
    config = Config()
    config.set_main_option("script_location", "services.ui_api.record:migrations")
    newest_first = [script.revision for script in ScriptDirectory.from_config(config).walk_revisions()]
    return newest_first[:0:-1]


@pytest.fixture(params=["sqlite", "postgresql"])
def empty_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A database without any table."""
    if request.param == "sqlite":
        return sqlite_url(tmp_path)
    server: Server = request.getfixturevalue("postgresql")
    return server.url(server.make_database())


def _seen(connection: Connection) -> int:
    return int(connection.execute(text("SELECT count(*) FROM events")).scalar_one())


@pytest.mark.parametrize("revision", _revisions())
def test_a_filled_record_is_upgraded_while_it_is_read(empty_url: str, revision: str) -> None:
    old = engine_of(empty_url)
    upgrade(old, revision)
    record = record_of(old)
    fill(record)
    with record.write() as unit:
        unit.remember("key", "a" * 64, Answer(201, "{}", {}))
    before = verify_record(old)
    with old.connect() as reader:
        assert _seen(reader) == 2
        new = open_database(empty_url)
        assert _seen(reader) == 2
    remembered = record.remembered("key")
    old.dispose()
    assert isinstance(before, ChainIntact)
    assert verify_record(new) == before
    again = record_of(new)
    assert again.ledger.cases == record.ledger.cases
    assert again.remembered("key") == remembered
    again.append(STEP)
    with pytest.raises(IntegrityError, match="events are append-only"), new.begin() as connection:
        connection.execute(text("UPDATE events SET who = 'nobody'"))
    new.dispose()


def test_there_are_earlier_revisions() -> None:
    assert _revisions()[:2] == ["0001", "0002"]

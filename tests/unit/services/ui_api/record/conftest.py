"""The case record on both databases."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import Engine

from services.ui_api.record.database import open_database, sqlite_url
from tests.new_record import put_new_record
from tests.postgresql import Server, running_server, why_not_installed


@pytest.fixture(scope="session")
def postgresql() -> Iterator[Server]:
    """One server for all tests of a process."""
    if (why := why_not_installed()) is not None:
        pytest.skip(why)
    with running_server() as server:
        yield server


@pytest.fixture(scope="session")
def migrated(postgresql: Server) -> str:
    """Name of a database with all tables and nothing in them, to be copied."""
    name = postgresql.make_database()
    open_database(postgresql.url(name)).dispose()
    return name


@pytest.fixture(params=["sqlite", "postgresql"])
def record_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Where a record may be: one after the other on both databases."""
    if request.param == "sqlite":
        url = sqlite_url(tmp_path)
        put_new_record(url)
        return url
    server: Server = request.getfixturevalue("postgresql")
    return server.url(server.make_database(request.getfixturevalue("migrated")))


@pytest.fixture
def engine(record_url: str) -> Iterator[Engine]:
    opened = open_database(record_url)
    yield opened
    opened.dispose()

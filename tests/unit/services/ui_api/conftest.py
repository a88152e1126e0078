"""Fixtures of the gateway's tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from services.ui_api.access import passwords
from tests.unit.services.ui_api.room import Room, open_room


@pytest.fixture(scope="session", autouse=True)
def fast_passwords() -> Iterator[None]:
    """Hashes that are as fast as they can be: how slow they are in use is no matter of most tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(passwords, "_PASSES", 1)
        patch.setattr(passwords, "_MEMORY_KIB", 8)
        yield


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Room]:
    with open_room(tmp_path) as opened:
        yield opened


@pytest.fixture(scope="module")
def quiet_room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    """One for all tests of a module that leave no trace in it."""
    with open_room(tmp_path_factory.mktemp("quiet")) as opened:
        yield opened

"""Every test of this folder runs over each implementation of the bus."""

from collections.abc import Iterator

import pytest

from shared.bus.memory_bus import MemoryRouter
from tests.contract.bus.rooms import MemoryRoom, Room, RouterProcess, ZenohRoom


@pytest.fixture(scope="session")
def shared_router() -> Iterator[RouterProcess]:
    """One router process for all tests that do not harm it."""
    with RouterProcess() as router:
        yield router


@pytest.fixture(params=["memory", "zenoh"])
def room(request: pytest.FixtureRequest) -> Iterator[Room]:
    """A place where sessions can be opened."""
    if request.param == "memory":
        yield MemoryRoom(MemoryRouter())
    else:
        yield ZenohRoom(request.getfixturevalue("shared_router"))


@pytest.fixture(params=["memory", "zenoh"])
def own_room(request: pytest.FixtureRequest) -> Iterator[Room]:
    """A place whose link may be cut."""
    if request.param == "memory":
        yield MemoryRoom(MemoryRouter())
    else:
        with RouterProcess() as router:
            yield ZenohRoom(router)

"""One protected router for all tests that do not harm it."""

from collections.abc import Iterator

import pytest

from tests.contract.security.rooms import SecureRoom, secure_room


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SecureRoom]:
    with secure_room(tmp_path_factory.mktemp("pki")) as running:
        yield running

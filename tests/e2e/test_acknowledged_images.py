"""Images that were acknowledged are on record, and localised or said why not, whatever process is killed or hangs."""

import os
import signal
import time
from collections.abc import Callable, Iterator

import pytest

from benchmarks.common.operating_room import OperatingRoom
from distalock.client.models import ImageView
from tests.e2e.conftest import SEED, operating_room

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

# Longer than the interval of a run (0.5 s): what follows is a single shot.
APART_S = 0.7
# Longer than a link's lease (1 s): the others have noticed.
HUNG_S = 2.0
PATIENCE_S = 120.0


class Shooting:
    """An installation with an open case, and the images that it acknowledged."""

    def __init__(self, room: OperatingRoom) -> None:
        self.room = room
        self.case = room.open_case()
        self.acknowledged: list[str] = []

    def shoot(self) -> None:
        time.sleep(APART_S)
        self.acknowledged.append(self.room.room.take_shot())

    def images(self) -> dict[str, ImageView]:
        """The case's images on record, by their SOP instance UID."""
        return {one.sop_instance_uid: one for one in self.case.images()}

    def unfinished(self) -> list[str]:
        known = self.images()
        return [uid for uid in self.acknowledged if uid not in known or not _is_finished(known[uid])]

    def signal(self, service: str, number: signal.Signals) -> None:
        os.kill(self.room.fleet.pids[service], number)


def _is_finished(image: ImageView) -> bool:
    return image.localisation is not None or image.skipped is not None


def wait_until(condition: Callable[[], bool], what: Callable[[], str]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, what()
        time.sleep(0.2)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shooting]:
    with operating_room(tmp_path_factory.mktemp("images"), SEED) as room:
        yield Shooting(room)


def require_all_finished(site: Shooting) -> None:
    wait_until(lambda: not site.unfinished(), lambda: f"of {len(site.acknowledged)}: {site.unfinished()}")
    newest = site.images()[site.acknowledged[-1]]
    assert newest.localisation is not None, f"the newest image is localised: {newest.skipped}"
    listed = [uid for uid in site.images() if uid in site.acknowledged]
    assert listed == site.acknowledged, "on record in the order in which they were received"


# Without imaging nothing is acknowledged.
@pytest.mark.requirement("IMG-02")
@pytest.mark.parametrize(
    ("service", "shots_while_down"),
    [
        ("imaging", 0),
        pytest.param("registration", 2, marks=pytest.mark.long),
        pytest.param("ui_api", 2, marks=pytest.mark.long),
    ],
)
def test_a_killed_process_loses_no_acknowledged_image(site: Shooting, service: str, shots_while_down: int) -> None:
    for _ in range(2):
        site.shoot()
    site.signal(service, signal.SIGKILL)
    for _ in range(shots_while_down):
        site.shoot()
    site.room.fleet.restart(service)
    require_all_finished(site)


@pytest.mark.requirement("IMG-02")
@pytest.mark.parametrize(
    "service", ["registration", *(pytest.param(one, marks=pytest.mark.long) for one in ("imaging", "ui_api"))]
)
def test_a_hung_process_loses_no_acknowledged_image(site: Shooting, service: str) -> None:
    site.shoot()
    site.signal(service, signal.SIGSTOP)
    try:
        if service != "imaging":
            site.shoot()
        time.sleep(HUNG_S)
    finally:
        site.signal(service, signal.SIGCONT)
    require_all_finished(site)

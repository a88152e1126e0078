"""Two rooms at a site: a desk sees both and commands neither, and nobody of the site or of another room gets in."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime

import pytest

from distalock.site.command import router_arguments
from shared.bus.keys import Keys
from shared.bus.port import Answer
from shared.bus.settings import BusSettings
from shared.bus.site import ANY_SUMMARY, DESK, summary_key
from shared.bus.tls import PKI_FOLDER, TlsFiles
from shared.bus.zenoh_bus import ZenohBus, open_bus
from shared.errors import BusUnavailable, NoReply
from shared.messages.base import decode, encode
from shared.messages.presence import ServiceStatus
from shared.messages.site import RoomSummary
from shared.pki.site import site_keystore
from tests.contract.bus.rooms import PATIENCE_S, Collector, eventually, free_port
from tests.contract.security.rooms import ROOM, SecureRoom

OTHER = "other"
KEYS = Keys(ROOM)
SILENCE_S = 0.7
REFUSED_WITHIN_S = 2.0
STATUS = ServiceStatus(service="robot", boot_epoch="b", version="0.1.0", condition="ready", sent_at_ns=1)


@dataclass(frozen=True, slots=True)
class Site:
    """A running site router, and everybody's keys for it."""

    endpoint: str
    files: dict[str, TlsFiles]

    def open_as(self, name: str) -> ZenohBus:
        return open_bus(BusSettings(self.endpoint, PATIENCE_S, self.files[name]))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    state = tmp_path_factory.mktemp("site")
    keystore = site_keystore(state / PKI_FOLDER, (ROOM, OTHER))
    keystore.ensure(datetime.now(UTC))
    running = Site(
        f"tls/127.0.0.1:{free_port()}",
        {name: TlsFiles.in_folder(keystore.folder_of(name)) for name in (ROOM, OTHER, DESK)},
    )
    arguments = router_arguments(state, running.endpoint)
    with subprocess.Popen([sys.executable, "-m", "shared.bus.router", *arguments]) as process:
        try:
            with running.open_as(DESK):
                pass
            yield running
        finally:
            process.kill()


@contextmanager
def exporter(room: SecureRoom, site: Site) -> Iterator[None]:
    """The room's exporter as a process."""
    own, shown = room.files_of("exporter"), site.files[ROOM]
    words = [
        *(sys.executable, "-m", "shared.bus.exporter", "--room", ROOM, "--router", room.endpoint),
        *("--authority", str(own.authority), "--certificate", str(own.certificate), "--key", str(own.key)),
        *("--site", site.endpoint, "--site-keys", str(shown.key.parent)),
    ]
    with subprocess.Popen(words) as process:
        try:
            yield
        finally:
            process.terminate()


def silence() -> None:
    """Long enough for what is denied to come, if it came."""
    threading.Event().wait(SILENCE_S)


@pytest.mark.requirement("SEC-02")
def test_a_desk_sees_a_room_and_can_command_nothing_in_it(room: SecureRoom, site: Site) -> None:
    seen: Collector[RoomSummary] = Collector()
    commanded: Collector[str] = Collector()
    with ExitStack() as sessions, exporter(room, site):
        robot, desk = sessions.enter_context(room.open_as("robot")), sessions.enter_context(site.open_as(DESK))
        desk.subscribe_retained(ANY_SUMMARY, lambda sample: seen.add(decode(RoomSummary, sample.payload)))
        robot.declare_alive(KEYS.alive("robot"))
        robot.retained_publisher(KEYS.status("robot")).put(encode(STATUS))
        robot.queryable(KEYS.robot_command("stop"), lambda query: _noted(commanded, query.key))
        eventually(lambda: any(_robot_is_ready(summary) for summary in seen.items))
        assert {summary.room for summary in seen.items} == {ROOM}
        for key in (KEYS.robot_command("stop"), KEYS.robot_command("move"), summary_key(ROOM)):
            with pytest.raises(NoReply):
                desk.query(key, b"", SILENCE_S)
            desk._session.put(key, b"forged")
        silence()
        assert commanded.items == []


def _robot_is_ready(summary: RoomSummary) -> bool:
    return any((one.service, one.alive, one.condition) == ("robot", True, "ready") for one in summary.services)


def _noted(commanded: Collector[str], key: str) -> Answer:
    commanded.add(key)
    return Answer(b"done")


@pytest.mark.requirement("SEC-02")
@pytest.mark.parametrize("name", [ROOM, OTHER, DESK])
def test_no_key_of_the_site_opens_a_link_to_a_room(room: SecureRoom, site: Site, name: str) -> None:
    with pytest.raises(BusUnavailable), open_bus(BusSettings(room.endpoint, REFUSED_WITHIN_S, site.files[name])):
        pass


@pytest.mark.requirement("SEC-02")
def test_a_room_that_was_taken_over_speaks_for_itself_alone(site: Site) -> None:
    seen: Collector[str] = Collector()
    with ExitStack() as sessions:
        thief, desk = (sessions.enter_context(site.open_as(name)) for name in (OTHER, DESK))
        victim = sessions.enter_context(site.open_as(ROOM))
        desk.subscribe_retained(ANY_SUMMARY, lambda sample: seen.add(sample.key))
        victim.subscribe(summary_key(OTHER), lambda sample: seen.add(f"at the other room: {sample.key}"))
        thief.retained_publisher(summary_key(OTHER)).put(b"own")
        seen.wait_for(summary_key(OTHER))
        thief._session.put(summary_key(ROOM), b"forged")
        thief._session.put(KEYS.robot_command("stop"), b"forged")
        silence()
        assert set(seen.items) == {summary_key(OTHER)}


def test_an_exporter_sends_nothing_into_its_room(room: SecureRoom) -> None:
    heard: Collector[str] = Collector()
    with ExitStack() as sessions:
        robot, gateway = (sessions.enter_context(room.open_as(name)) for name in ("robot", "ui_api"))
        robot.queryable(KEYS.robot_command("stop"), lambda query: _noted(heard, query.key))
        robot.subscribe(KEYS.plan, lambda sample: heard.add(sample.key))
        gateway.subscribe(KEYS.robot_state, lambda sample: heard.add(sample.key))
        thief = sessions.enter_context(room.open_as("exporter"))
        silence()
        for key in (KEYS.plan, KEYS.robot_state, KEYS.case_context):
            thief._session.put(key, b"forged")
        with pytest.raises(NoReply):
            thief.query(KEYS.robot_command("stop"), b"", SILENCE_S)
        silence()
        assert heard.items == []

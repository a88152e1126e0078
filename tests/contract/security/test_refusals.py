"""What a router process refuses, the gateway hears from it, by name; and nothing else."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from shared.bus.access import SERVICES
from shared.bus.keys import Keys
from shared.bus.port import Answer, Sample
from shared.bus.settings import BusSettings
from shared.bus.zenoh_bus import open_bus
from shared.errors import BusUnavailable, NoReply
from shared.messages.base import MessageInvalid, decode, encode
from shared.messages.refusals import BusRefusals, RefusalCode
from shared.pki.authority import Use, issue
from tests.contract.bus.rooms import Collector, eventually
from tests.contract.security.rooms import ROOM, SecureRoom
from tests.contract.security.test_links import FORGERIES, NOW, REFUSED_WITHIN_S, authority_of, written

KEYS = Keys(ROOM)
ASK_FOR_S = 0.2
Seen = set[tuple[str, str, str]]


class Reports:
    """What the gateway hears of the router."""

    def __init__(self) -> None:
        self._heard: Collector[BusRefusals] = Collector()

    def take(self, sample: Sample) -> None:
        with suppress(MessageInvalid):
            self._heard.add(decode(BusRefusals, sample.payload))

    def newest(self) -> BusRefusals | None:
        return self._heard.items[-1] if self._heard.items else None

    def seen(self, code: RefusalCode) -> Seen:
        report = self.newest()
        entries = () if report is None else report.newest
        return {(entry.service, entry.what, entry.key) for entry in entries if entry.code is code}


@pytest.fixture
def reports(room: SecureRoom) -> Iterator[Reports]:
    heard = Reports()
    with room.open_as("ui_api") as gateway:
        gateway.subscribe(KEYS.bus_refusals, heard.take)
        yield heard


def test_every_kind_of_denied_message_is_reported_with_its_sender(room: SecureRoom, reports: Reports) -> None:
    stop = KEYS.robot_command("stop")
    with room.open_as("imaging") as imaging:
        imaging._session.put(KEYS.robot_state, b"forged")
        imaging.subscribe(KEYS.plan, lambda _: None)
        with pytest.raises(NoReply):
            imaging.query(stop, b"", ASK_FOR_S)
        imaging.queryable(stop, lambda _: Answer(b"forged"))
        imaging.declare_alive(KEYS.alive("robot"))
        imaging.watch_alive(KEYS.alive("robot"), lambda _key, _alive: None)
        expected = {
            ("imaging", "Put", KEYS.robot_state),
            ("imaging", "Declare Subscriber", KEYS.plan),
            ("imaging", "Declare Queryable", stop),
            ("imaging", "Query", stop),
            ("imaging", "Liveliness Token", KEYS.alive("robot")),
            ("imaging", "Declare Liveliness Subscriber", KEYS.alive("robot")),
        }
        eventually(lambda: expected <= reports.seen(RefusalCode.MESSAGE_DENIED))


def test_a_refused_link_and_an_unknown_name_are_reported(room: SecureRoom, reports: Reports, tmp_path: Path) -> None:
    authority = authority_of(room.keystore)
    forged, stranger = tmp_path / "forged", tmp_path / "stranger"
    forged.mkdir()
    stranger.mkdir()
    with pytest.raises(BusUnavailable):
        open_bus(
            BusSettings(room.endpoint, REFUSED_WITHIN_S, written(forged, FORGERIES["expired"](authority), authority))
        )
    unknown = written(stranger, issue(authority, "stranger", Use.CLIENT, (), NOW), authority)
    with open_bus(BusSettings(room.endpoint, REFUSED_WITHIN_S, unknown)):
        pass
    expired = ("", "invalid peer certificate: certificate expired", "")
    eventually(lambda: expired in reports.seen(RefusalCode.LINK_REFUSED))
    eventually(lambda: ("stranger", "no rules for this name", "") in reports.seen(RefusalCode.UNKNOWN_NAME))


def test_no_service_reports_in_the_routers_name(room: SecureRoom, reports: Reports) -> None:
    eventually(lambda: reports.newest() is not None)
    forged = BusRefusals(router_epoch="forged", messages_denied=0, links_refused=0, unknown_names=0, gaps=0, newest=())
    for service in SERVICES:
        with room.open_as(service) as thief:
            thief._session.put(KEYS.bus_refusals, encode(forged))
            put = (service, "Put", KEYS.bus_refusals)
            eventually(lambda put=put: put in reports.seen(RefusalCode.MESSAGE_DENIED))  # type: ignore[misc]
    newest = reports.newest()
    assert newest is not None
    assert newest.router_epoch != "forged"

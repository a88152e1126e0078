"""Every client tries everything on every key: what its row allows arrives, and nothing else does.

Each service has two sessions, one that provides and one that consumes: a session hears itself without the router.
"""

import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path

import pytest

from shared.bus.access import CLIENTS, SERVICES, Exchange, Row, access_table
from shared.bus.keys import Keys
from shared.bus.port import Answer, Bus, Sample
from shared.bus.zenoh_bus import ZenohBus
from shared.errors import NoReply
from shared.messages.presence import ServiceName
from shared.pki.keystore import Keystore
from tests.contract.bus.rooms import PATIENCE_S, Collector, eventually, free_port
from tests.contract.security.rooms import ROOM, SecureRoom, running_router_of

KEYS = Keys(ROOM)
TABLE = access_table(KEYS)
# What is denied never comes, so it must be waited for; what is allowed came within 20 ms where nothing else ran.
SILENCE_S = 0.7
Sessions = dict[str, ZenohBus]
Arrived = set[tuple[str, str, str]]


@pytest.fixture
def providers(room: SecureRoom) -> Iterator[Sessions]:
    with ExitStack() as stack:
        yield {service: stack.enter_context(room.open_as(service)) for service in CLIENTS}


@pytest.fixture
def consumers(room: SecureRoom) -> Iterator[Sessions]:
    with ExitStack() as stack:
        yield {service: stack.enter_context(room.open_as(service)) for service in CLIENTS}


def rows(*exchanges: Exchange) -> list[Row]:
    """Rows that a service provides; what the router says itself: `test_refusals`."""
    found = [row for row in TABLE if row.exchange in exchanges and row.provider in SERVICES]
    assert found
    return found


def concrete(key: str) -> str:
    """A key that a row's expression covers."""
    return key.replace("*", "some")


def provider_of(row: Row) -> str:
    """Of a row that a service provides."""
    return next(service for service in SERVICES if service == row.provider)


def allowed(table: list[Row]) -> Arrived:
    """(provider, consumer, key) of all that may arrive."""
    return {(provider_of(row), consumer, concrete(row.key)) for row in table for consumer in row.consumers}


class Record:
    """What arrived, from whom, at whom."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.arrived: Arrived = set()

    def at(self, consumer: str) -> Callable[[Sample], None]:
        def note(sample: Sample) -> None:
            with self._lock:
                self.arrived.add((_service(sample.payload), consumer, sample.key))

        return note

    def token_at(self, watcher: str) -> Callable[[str, bool], None]:
        def note(key: str, _alive: bool) -> None:  # noqa: FBT001 - the signature is the bus's
            with self._lock:
                self.arrived.add((watcher, watcher, key))

        return note

    def settle(self, expected: Arrived) -> Arrived:
        """What has arrived when all that is expected has, and silence followed."""
        eventually(lambda: expected <= self.arrived)
        silence()
        return self.arrived


def silence() -> None:
    """Long enough for what is denied to come, if it came."""
    threading.Event().wait(SILENCE_S)


def _service(payload: bytes) -> str:
    return next(service for service in CLIENTS if service == payload.decode())


def subscribe_to_all(consumers: Sessions, table: list[Row], record: Record) -> None:
    for service, bus in consumers.items():
        for row in table:
            subscribe = bus.subscribe_retained if row.exchange is Exchange.RETAINED else bus.subscribe
            subscribe(row.key, record.at(service))


def publish_as_everybody(providers: Sessions, table: list[Row]) -> None:
    """Each service on every key, those that it may not use first."""
    for service, bus in providers.items():
        for row in sorted(table, key=lambda row: row.provider == service):
            publish = bus.retained_publisher if row.exchange is Exchange.RETAINED else bus.publisher
            publish(concrete(row.key)).put(service.encode())
            if row.provider != service:
                # A declared publisher keeps to itself what it knows no subscriber of; this does not.
                bus._session.put(concrete(row.key), service.encode())


@pytest.mark.requirement("SEC-02")
def test_samples_arrive_from_their_provider_at_their_consumers_and_nowhere_else(
    providers: Sessions, consumers: Sessions
) -> None:
    table, record = rows(Exchange.STREAM, Exchange.RETAINED), Record()
    subscribe_to_all(consumers, table, record)
    until_declared(consumers)
    publish_as_everybody(providers, table)
    assert record.settle(allowed(table)) == allowed(table)


def test_a_publisher_that_is_there_for_long_reaches_who_subscribes_later(
    providers: Sessions, consumers: Sessions
) -> None:
    """A publisher that knows no subscriber sends nothing: it must hear of those that come."""
    table, record = rows(Exchange.STREAM, Exchange.RETAINED), Record()
    publishers = {
        row.key: providers[provider_of(row)].retained_publisher(row.key)
        if row.exchange is Exchange.RETAINED
        else providers[provider_of(row)].publisher(row.key)
        for row in table
    }
    silence()
    for service, bus in consumers.items():
        for row in table:
            bus.subscribe(row.key, record.at(service))
    until_declared(consumers)
    silence()
    for row in table:
        publishers[row.key].put(row.provider.encode())
    assert record.settle(allowed(table)) == allowed(table)


def test_late_joiners_get_the_last_value_of_the_provider_and_no_other(providers: Sessions, consumers: Sessions) -> None:
    table, record = rows(Exchange.RETAINED), Record()
    publish_as_everybody(providers, table)
    until_declared(providers)
    subscribe_to_all(consumers, table, record)
    assert record.settle(allowed(table)) == allowed(table)


def test_a_value_that_was_put_without_a_link_arrives_after_it(tmp_path: Path) -> None:
    arrived: Collector[bytes] = Collector()
    room = SecureRoom(f"tls/127.0.0.1:{free_port()}", Keystore(tmp_path))
    room.keystore.ensure(datetime.now(UTC))
    with ExitStack() as sessions:
        with running_router_of(room):
            robot, gateway = (sessions.enter_context(room.open_as(name)) for name in ("robot", "ui_api"))
            publisher = robot.retained_publisher(KEYS.robot_state)
            publisher.put(b"before")
            gateway.subscribe_retained(KEYS.robot_state, lambda sample: arrived.add(sample.payload))
            arrived.wait_for(b"before")
        eventually(lambda: not robot.link_up())
        publisher.put(b"meanwhile")
        with running_router_of(room):
            arrived.wait_for_last(b"meanwhile")


def test_the_newest_number_of_a_retained_key_reaches_its_consumers(providers: Sessions, consumers: Sessions) -> None:
    """By it a consumer learns that it missed the last value, and asks for it."""
    told: Collector[str] = Collector()
    keys = f"{KEYS.robot_state}/@adv/**"
    with consumers["ui_api"]._session.declare_subscriber(keys, lambda sample: told.add(str(sample.key_expr))):
        until_declared(consumers)
        publisher = providers["robot"].retained_publisher(KEYS.robot_state)
        publisher.put(b"1")
        told.wait_until(1)


def test_answers_come_from_the_provider_to_who_may_ask(providers: Sessions, consumers: Sessions) -> None:
    table = rows(Exchange.QUERY)
    asked: defaultdict[str, set[str]] = defaultdict(set)

    def answer_as(service: str, *, own: bool) -> None:
        for row in table:
            if (row.provider == service) == own:
                providers[service].queryable(row.key, answering(service, asked))

    for service in CLIENTS:
        answer_as(service, own=False)
    until_declared(providers)
    assert ask_all(consumers, table, lambda _row, _consumer: SILENCE_S) == set()
    assert asked == {}
    for service in SERVICES:
        answer_as(service, own=True)
    until_declared(providers)
    may_ask = ask_all(consumers, table, lambda row, one: PATIENCE_S if one in row.consumers else SILENCE_S)
    assert may_ask == allowed(table)
    assert {(key, *who) for key, who in asked.items()} == {(concrete(row.key), row.provider) for row in table}


def answering(service: str, asked: defaultdict[str, set[str]]) -> Callable[..., Answer]:
    def answer(query: object) -> Answer:
        asked[getattr(query, "key", "")].add(service)
        return Answer(service.encode())

    return answer


def ask_all(consumers: Sessions, table: list[Row], timeout_s: Callable[[Row, str], float]) -> Arrived:
    """Who got an answer from whom, on which key."""

    def ask(consumer: str, row: Row) -> Arrived:
        key = concrete(row.key)
        try:
            answer = consumers[consumer].query(key, b"", timeout_s(row, consumer))
        except NoReply:
            return set()
        return {(_service(answer.payload), consumer, key)}

    with ThreadPoolExecutor(16) as pool:
        waiting = [pool.submit(ask, consumer, row) for consumer in consumers for row in table]
        return set().union(*(one.result() for one in waiting))


def test_tokens_are_seen_of_their_holder_by_who_may_watch(providers: Sessions, consumers: Sessions) -> None:
    table, lock = rows(Exchange.TOKEN), threading.Lock()
    seen: set[tuple[str, str]] = set()

    def note(watcher: str) -> Callable[[str, bool], None]:
        def handle(key: str, _alive: bool) -> None:  # noqa: FBT001 - the signature is the bus's
            with lock:
                seen.add((watcher, key))

        return handle

    for service, bus in consumers.items():
        for row in table:
            bus.watch_alive(row.key, note(service))
    for service, bus in providers.items():
        for row in table:
            if row.provider != service:
                bus.declare_alive(concrete(row.key))
    silence()
    assert seen == set(), "a token of somebody else's name was seen"
    for row in table:
        providers[provider_of(row)].declare_alive(concrete(row.key))
    expected = {(consumer, concrete(row.key)) for row in table for consumer in row.consumers}
    eventually(lambda: expected <= seen)
    silence()
    assert seen == expected


def test_a_late_watcher_sees_tokens_that_are_there(providers: Sessions, consumers: Sessions) -> None:
    seen = threading.Event()
    providers["robot"].declare_alive(KEYS.alive("robot"))
    until_declared(providers)
    consumers["ui_api"].watch_alive(KEYS.alive("robot"), lambda _key, alive: seen.set() if alive else None)
    assert seen.wait(PATIENCE_S)


WIDER = ("**", "distalock/**", f"distalock/v1/{ROOM}/**", f"distalock/v1/{ROOM}/robot/*", "@/*/router/**")
ELSEWHERE = ("other", f"distalock/v1/other/{KEYS.robot_state.split('/', 3)[3]}", f"distalock/v1/{ROOM}/robot/more")


@pytest.mark.requirement("SEC-02")
def test_no_expression_wider_than_a_row_brings_anything(providers: Sessions, consumers: Sessions) -> None:
    table, record = rows(Exchange.STREAM, Exchange.RETAINED), Record()
    for service, bus in consumers.items():
        for key in WIDER:
            bus.subscribe(key, record.at(service))
            bus.watch_alive(key, record.token_at(service))
    silence()
    publish_as_everybody(providers, table)
    providers["robot"].declare_alive(KEYS.alive("robot"))
    silence()
    assert record.arrived == set()
    with ThreadPoolExecutor(16) as pool:
        asked = [pool.submit(answered, bus, key) for bus in consumers.values() for key in WIDER]
        assert not any(one.result() for one in asked)


def answered(bus: Bus, key: str) -> bool:
    try:
        bus.query(key, b"", SILENCE_S)
    except NoReply:
        return False
    return True


def test_keys_outside_the_table_carry_nothing(providers: Sessions, consumers: Sessions) -> None:
    record = Record()
    for service, bus in consumers.items():
        for key in ELSEWHERE:
            bus.subscribe(key, record.at(service))
    for service, bus in providers.items():
        for key in ELSEWHERE:
            bus._session.put(key, service.encode())
    silence()
    assert record.arrived == set()


def until_declared(sessions: Sessions) -> None:
    """Return when the router knows what sessions have declared: a session's messages reach it in their order."""
    for service, bus in sessions.items():
        if service not in SERVICES:  # the exporter, which may show nothing; what it misses it asks for
            continue
        known = threading.Event()
        watch = sessions["ui_api"].watch_alive(KEYS.alive(_named(service)), announcing(known))
        token = bus.declare_alive(KEYS.alive(_named(service)))
        assert known.wait(PATIENCE_S), f"the token of {service} did not arrive"
        token.close()
        watch.close()


def _named(client: str) -> ServiceName:
    return next(service for service in SERVICES if service == client)


def announcing(known: threading.Event) -> Callable[[str, bool], None]:
    return lambda _key, _alive: known.set()

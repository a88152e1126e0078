"""Each service's stolen key in the role of each other service: speaks, answers, asks and holds tokens in its place."""

import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import Final

from shared.bus.access import SERVICES, Exchange, Row, access_table
from shared.bus.port import Answer, Query
from shared.bus.zenoh_bus import ZenohBus
from shared.errors import NoReply
from shared.messages.presence import ServiceName
from tests.attacks.attack import Attack, Record
from tests.attacks.site import Site, silence

UNHEARD: Final = "unheard"
_FORGED: Final = b"forged"
_ASK_FOR_S: Final = 0.5


class _Heard:
    """What reached somebody that should not have."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.of: list[str] = []

    def note(self, what: str) -> None:
        with self._lock:
            self.of.append(what)


def _in_the_role_of(thief: ServiceName, victim: ServiceName) -> Callable[[Site], str]:
    def run(site: Site) -> str:
        table, heard = access_table(site.keys), _Heard()
        with ExitStack() as sessions:
            stolen = sessions.enter_context(site.open_as(thief))
            others: dict[str, ZenohBus] = {
                name: sessions.enter_context(site.open_as(name)) for name in SERVICES if name not in (thief, victim)
            }
            _listen(others, table, victim, heard)
            silence()
            _speak(stolen, [row for row in table if row.provider == victim], heard)
            _ask(stolen, [row for row in table if victim in row.consumers and thief not in row.consumers], heard)
            silence()
        return "; ".join(sorted(set(heard.of))) or UNHEARD

    return run


def _listen(others: dict[str, ZenohBus], table: tuple[Row, ...], victim: ServiceName, heard: _Heard) -> None:
    """Whoever may hear the victim listens for what is forged, or for a token that appears."""
    for row in table:
        for consumer in row.consumers & others.keys():
            if row.provider != victim:
                continue
            if row.exchange in (Exchange.STREAM, Exchange.RETAINED):
                others[consumer].subscribe(row.key, lambda sample: _note_forged(sample.payload, sample.key, heard))
            elif row.exchange is Exchange.TOKEN:
                others[consumer].watch_alive(row.key, lambda key, _alive: _note_stolen(key, heard))


def _note_forged(payload: bytes, key: str, heard: _Heard) -> None:
    if payload == _FORGED:
        heard.note(f"{key} was forged")


def _note_stolen(key: str, heard: _Heard) -> None:
    if key.endswith(_FORGED.decode()):
        heard.note(f"{key} was held")


def _speak(stolen: ZenohBus, rows: list[Row], heard: _Heard) -> None:
    """Publish, answer and hold tokens in the victim's place."""

    def answer(query: Query) -> Answer:
        heard.note(f"{query.key} was answered")
        return Answer(_FORGED)

    for row in rows:
        key = row.key.replace("*", _FORGED.decode())
        match row.exchange:
            case Exchange.STREAM | Exchange.RETAINED:
                stolen._session.put(key, _FORGED)
            case Exchange.QUERY:
                stolen.queryable(row.key, answer)
            case Exchange.TOKEN:
                stolen.declare_alive(key)


def _ask(stolen: ZenohBus, rows: list[Row], heard: _Heard) -> None:
    """Ask what only the victim may ask: commands to the robot, plans, frames."""
    for row in rows:
        if row.exchange is not Exchange.QUERY:
            continue
        try:
            stolen.query(row.key.replace("*", _FORGED.decode()), _FORGED, _ASK_FOR_S)
        except NoReply:
            continue
        heard.note(f"{row.key} answered")


ATTACKS: Final = tuple(
    Attack(
        f"{thief} as {victim}",
        f"{thief}'s key",
        f"publish, answer, ask and hold tokens as {victim}",
        UNHEARD,
        Record("case-record", f"bus_refused.*{victim}/heartbeat.*{thief}"),
        _in_the_role_of(thief, victim),
    )
    for thief in SERVICES
    for victim in SERVICES
    if thief != victim
)

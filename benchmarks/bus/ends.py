"""The two ends of a bus that is timed: one sends frames and asks, the other receives frames and answers."""

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final, Literal, Protocol

import zenoh

from shared.bus.keys import Keys
from shared.bus.port import Answer
from shared.bus.settings import BusSettings
from shared.bus.tls import TlsFiles
from shared.bus.zenoh_bus import ZenohBus, open_bus

Kind = Literal["bare", "plain", "protected"]
KINDS: Final[tuple[Kind, ...]] = ("bare", "plain", "protected")
KEYS = Keys("or1")
COMMAND: Final = KEYS.robot_command("stop")
TIMEOUT_S: Final = 5.0


class NearEnd(Protocol):
    """Sends and asks."""

    def send(self, frame: bytes, header: bytes) -> None:
        """Publish one frame."""

    def ask(self, question: bytes) -> bytes:
        """Wait for the answer to one command."""


class BareNearEnd:
    """As Zenoh's own examples do it, with its defaults."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._publisher = session.declare_publisher(KEYS.frame)

    def send(self, frame: bytes, header: bytes) -> None:
        """See `NearEnd`."""
        self._publisher.put(frame, attachment=header)

    def ask(self, question: bytes) -> bytes:
        """See `NearEnd`."""
        for reply in self._session.get(COMMAND, payload=question, timeout=TIMEOUT_S):
            if reply.ok is not None:
                return bytes(reply.ok.payload.to_bytes())
        raise TimeoutError(f"nobody answered within {TIMEOUT_S:g} s")


class OurNearEnd:
    """As the services do it: imaging sends, the gateway asks."""

    def __init__(self, imaging: ZenohBus, gateway: ZenohBus) -> None:
        self._publisher = imaging.publisher(KEYS.frame)
        self._gateway = gateway

    def send(self, frame: bytes, header: bytes) -> None:
        """See `NearEnd`."""
        self._publisher.put(frame, header)

    def ask(self, question: bytes) -> bytes:
        """See `NearEnd`."""
        return self._gateway.query(COMMAND, question, TIMEOUT_S).payload


@contextmanager
def near_end(kind: Kind, endpoint: str, state_dir: Path) -> Iterator[NearEnd]:
    """Sessions that send and ask."""
    if kind == "bare":
        with _bare_session(endpoint) as session:
            yield BareNearEnd(session)
        return
    with _service(endpoint, state_dir, "imaging") as imaging, _service(endpoint, state_dir, "ui_api") as gateway:
        yield OurNearEnd(imaging, gateway)


@contextmanager
def far_end(kind: Kind, endpoint: str, state_dir: Path, on_frame: Callable[[bytes, bytes], None]) -> Iterator[None]:
    """Sessions that receive frames with their headers, and answer every command with itself."""
    with ExitStack() as stack:
        if kind == "bare":
            session = stack.enter_context(_bare_session(endpoint))
            stack.enter_context(session.declare_subscriber(KEYS.frame, lambda sample: _received(sample, on_frame)))
            stack.enter_context(session.declare_queryable(COMMAND, _echo))
        else:
            gateway = stack.enter_context(_service(endpoint, state_dir, "ui_api"))
            robot = stack.enter_context(_service(endpoint, state_dir, "robot"))
            gateway.subscribe(KEYS.frame, lambda sample: on_frame(sample.payload, sample.attachment))
            robot.queryable(COMMAND, lambda query: Answer(query.payload))
        yield


def _received(sample: zenoh.Sample, on_frame: Callable[[bytes, bytes], None]) -> None:
    header = b"" if sample.attachment is None else sample.attachment.to_bytes()
    on_frame(sample.payload.to_bytes(), header)


def _echo(query: zenoh.Query) -> None:
    with query:
        query.reply(query.key_expr, b"" if query.payload is None else query.payload.to_bytes())


def _bare_session(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps("client"))
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def _service(endpoint: str, state_dir: Path, name: str) -> ZenohBus:
    tls = TlsFiles.in_state(state_dir, name) if endpoint.startswith("tls/") else None
    return open_bus(BusSettings(endpoint, tls=tls))

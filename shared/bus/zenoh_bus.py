"""The bus over Zenoh: a client of one router.

Every service connects to the router and to nobody else: peers that link directly would bypass its access control.
Samples, queries and tokens go through ring channels to one thread per declaration. A Python callback handed to Zenoh
itself would, while it hangs, stall the whole session (measured on 1.10: one hung subscriber, and queries of the same
session time out); here a hung handler costs its own key its oldest samples and nothing else.
"""

import json
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar
from weakref import WeakSet

import zenoh

from shared.bus.declarations import Channel, Declared, pump
from shared.bus.frame_pool import FramePool
from shared.bus.liveliness import AliveView
from shared.bus.port import Answer, Query, QueryHandler, Sample
from shared.bus.replies import answered, error_text, no_answer, no_reply_in_time, outcome_of, replied_with_error
from shared.bus.settings import BusSettings as BusSettings
from shared.bus.shared_memory import unlock_pools
from shared.bus.tls import TlsFiles
from shared.errors import BusUnavailable
from shared.tracing import current_traceparent

# Chosen: a process that hangs is noticed within it; a keep-alive is sent several times in it.
_LEASE_MS = 1000
# Chosen: a router that restarts is found within a second.
_RECONNECT_FIRST_MS = 100
_RECONNECT_MOST_MS = 1000
# With Zenoh's own 1 ms and 50 ms, one in twelve first frames of 4 MB was lost, and on a busy machine one in four with
# 200 ms. The wait must stay well below the lease: meanwhile the router does not read from the publisher.
_WAIT_BEFORE_DROP_US = 20_000
_FRAGMENTS_WAIT_US = 400_000
_LAST_VALUE_CHECK_S = 0.5
_OPEN_AGAIN_AFTER_S = 0.1
_STREAM_DEPTH = 8
_RETAINED_DEPTH = 256
_QUERY_DEPTH = 256
_TOKEN_DEPTH = 1024
# They end at once when nothing hangs in a handler; a service that leaves is ended by force after 10 s.
_PUMP_ENDS_WITHIN_S = 1.0
_TIMEOUT_TEXT = "Timeout"

# What is retained stays in a cache, and would keep its place in a pool.
_NO_POOL = FramePool(0)

T = TypeVar("T")


def open_bus(settings: BusSettings) -> "ZenohBus":
    """Connect to the router. Use the result as a context manager.

    Raises
    ------
    BusUnavailable
        When no router answers within `open_timeout_s`, or none that the authority has signed, or it takes no link from
        this program.
    ConfigurationError
        When a file of `tls` is missing, or others can read the key.
    """
    if settings.tls is not None:
        settings.tls.require()
    deadline = time.monotonic() + settings.open_timeout_s
    while True:
        try:
            session = zenoh.open(client_config(settings))
        except zenoh.ZError as error:
            if time.monotonic() + _OPEN_AGAIN_AFTER_S > deadline:
                raise BusUnavailable(
                    f"no router answered at {settings.endpoint} within {settings.open_timeout_s:g} s; "
                    "start the router (python -m shared.bus.router), or correct the endpoint or the certificates "
                    "(distalock pki show)"
                ) from error
        else:
            unlock_pools()
            return ZenohBus(session)
        time.sleep(_OPEN_AGAIN_AFTER_S)


def client_config(settings: BusSettings) -> zenoh.Config:
    """Configuration of a service's session: client, one endpoint, no scouting, no listeners, short lease."""
    config = zenoh.Config()
    values: dict[str, object] = {
        "mode": "client",
        "connect/endpoints": [settings.endpoint],
        "connect/timeout_ms": 0,
        "connect/retry": {
            "period_init_ms": _RECONNECT_FIRST_MS,
            "period_max_ms": _RECONNECT_MOST_MS,
            "period_increase_factor": 2,
        },
        "listen/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": _LEASE_MS,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": _WAIT_BEFORE_DROP_US,
        "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": _FRAGMENTS_WAIT_US,
        "transport/shared_memory/mode": "init",
        "transport/shared_memory/transport_optimization/enabled": False,  # see `frame_pool`
        **(_tls_values(settings.tls) if settings.tls is not None else {}),
    }
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _tls_values(files: TlsFiles) -> dict[str, object]:
    return {
        "transport/link/tls/root_ca_certificate": str(files.authority),
        "transport/link/tls/connect_certificate": str(files.certificate),
        "transport/link/tls/connect_private_key": str(files.key),
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/verify_name_on_connect": True,
        "transport/link/tls/close_link_on_expiration": True,
    }


class _Publisher(Declared):
    """Publishes by shared memory what is large, when it is given a pool."""

    def __init__(
        self,
        publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher,
        kept: set[Declared],
        pool: FramePool = _NO_POOL,
    ) -> None:
        super().__init__(publisher, kept)
        self._publisher = publisher
        self._pool = pool

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        try:
            self._publisher.put(self._pool.placed(payload), attachment=attachment)
        except zenoh.ZError as error:
            raise BusUnavailable(f"'{self._publisher.key_expr}' cannot be published: {error}") from error


class ZenohBus:
    """One Zenoh session: a `Bus`, and its own `Presence`."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._kept: set[Declared] = set()
        self._pool = FramePool.of_this_process()
        self._pumps: WeakSet[threading.Thread] = WeakSet()  # those that still run
        self._views: list[AliveView] = []
        links = session.info.declare_transport_events_listener(zenoh.handlers.RingChannel(_TOKEN_DEPTH))
        self._serve(links, self._on_link, "link")

    def publisher(self, key: str) -> _Publisher:
        """See `Bus`."""
        publisher = self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP, express=True)
        return _Publisher(publisher, self._kept, self._pool)

    def retained_publisher(self, key: str) -> _Publisher:
        """See `Bus`."""
        publisher = zenoh.ext.declare_advanced_publisher(
            self._session,
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
            cache=zenoh.ext.CacheConfig(max_samples=1),
            sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_LAST_VALUE_CHECK_S),
            publisher_detection=True,
        )
        return _Publisher(publisher, self._kept)

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> Declared:
        """See `Bus`."""
        return self._subscribe(key, lambda sample: handler(_sample(sample)))

    def subscribe_attachments(self, key: str, handler: Callable[[bytes], None]) -> Declared:
        """See `Bus`."""
        return self._subscribe(key, lambda sample: handler(_bytes(sample.attachment)))

    def _subscribe(self, key: str, handle: Callable[[zenoh.Sample], None]) -> Declared:
        return self._serve(
            self._session.declare_subscriber(key, zenoh.handlers.RingChannel(_STREAM_DEPTH)), handle, key
        )

    def subscribe_retained(self, key: str, handler: Callable[[Sample], None]) -> Declared:
        """See `Bus`."""
        channel = zenoh.ext.declare_advanced_subscriber(
            self._session,
            key,
            zenoh.handlers.RingChannel(_RETAINED_DEPTH),
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
            recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )
        return self._serve(channel, lambda sample: handler(_sample(sample)), key)

    def queryable(self, key: str, handler: QueryHandler) -> Declared:
        """See `Bus`."""
        channel = self._session.declare_queryable(key, zenoh.handlers.RingChannel(_QUERY_DEPTH))
        return self._serve(channel, lambda query: _answer(handler, query), key)

    def query(self, key: str, payload: bytes, timeout_s: float) -> Answer:
        """See `Bus`; raises `NoReply`, or `BusUnavailable` when the session takes no question."""
        try:
            replies = self._session.get(
                key,
                payload=payload,
                attachment=current_traceparent(),
                timeout=timeout_s,
                target=zenoh.QueryTarget.BEST_MATCHING,
                consolidation=zenoh.ConsolidationMode.NONE,
                express=True,
            )
        except zenoh.ZError as error:
            raise BusUnavailable(f"'{key}' cannot be asked: {error}; see to the router and the network") from error
        for reply in replies:
            if reply.ok is not None:
                return Answer(reply.ok.payload.to_bytes(), _bytes(reply.ok.attachment))
            text = reply.err.payload.to_string() if reply.err is not None else ""
            if text == _TIMEOUT_TEXT:
                raise no_reply_in_time(key, timeout_s)
            raise replied_with_error(key, text)
        raise no_answer(key)

    def presence(self) -> "ZenohBus":
        """The session itself."""
        return self

    def declare_alive(self, key: str) -> Declared:
        """See `Presence`."""
        return Declared(self._session.liveliness().declare_token(key), self._kept)

    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> Declared:
        """See `Presence`."""
        view = AliveView(handler)
        self._views.append(view)
        channel = self._session.liveliness().declare_subscriber(
            key, zenoh.handlers.RingChannel(_TOKEN_DEPTH), history=True
        )
        return self._serve(channel, lambda token: view.on_token(str(token.key_expr), alive=_is_put(token.kind)), key)

    def link_up(self) -> bool:
        """See `Presence`."""
        return bool(self._session.info.routers_zid())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Take all declarations back, close, and wait for the threads that served them.

        A thread that comes back from Zenoh while the interpreter ends would abort the process.
        """
        for declared in tuple(self._kept):
            declared.close()
        self._session.close()  # type: ignore[no-untyped-call]
        for thread in tuple(self._pumps):
            if thread is not threading.current_thread():
                thread.join(_PUMP_ENDS_WITHIN_S)

    def _on_link(self, event: zenoh.TransportEvent) -> None:
        for view in self._views:
            view.on_link(up=_is_put(event.kind))

    def _serve(self, channel: Channel[T], handle: Callable[[T], None], key: str) -> Declared:
        self._pumps.add(pump(channel, handle, key))
        return Declared(channel, self._kept)


def _is_put(kind: zenoh.SampleKind) -> bool:
    return kind == zenoh.SampleKind.PUT


def _bytes(value: zenoh.ZBytes | None) -> bytes:
    return b"" if value is None else value.to_bytes()


def _text(value: zenoh.ZBytes | None) -> str:
    return _bytes(value).decode("ascii", "replace")


def _sample(sample: zenoh.Sample) -> Sample:
    payload = sample.payload
    shared = payload.as_shm() is not None
    if shared:
        unlock_pools()  # the sender's may have been mapped for this sample
    return Sample(str(sample.key_expr), payload.to_bytes(), _bytes(sample.attachment), by_shared_memory=shared)


def _answer(handler: QueryHandler, query: zenoh.Query) -> None:
    try:
        answer = answered(handler, Query(str(query.key_expr), _bytes(query.payload), _text(query.attachment)))
    except Exception as error:
        _reply(query, error_text(error))
        raise
    if isinstance(answer, Answer):
        _reply(query, answer)
    else:
        answer.add_done_callback(lambda done: _reply(query, outcome_of(done)))


def _reply(query: zenoh.Query, outcome: Answer | str) -> None:
    """Give the answer, or the text of an error."""
    with query:
        if isinstance(outcome, Answer):
            query.reply(query.key_expr, outcome.payload, attachment=outcome.attachment)
        else:
            query.reply_err(outcome)

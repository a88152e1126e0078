"""The client, answered at once."""

import threading
import time
from collections.abc import Generator
from types import TracebackType
from typing import Final, Self, TypeVar

import httpx

from distalock.client import calls
from distalock.client.answer import RawAnswer
from distalock.client.call import Call, escaped
from distalock.client.connection import (
    ACCEPT_EVENTS,
    RECONNECT_AFTER_S,
    STREAM_TIMEOUT,
    raw_answer,
    require_place,
    timeout,
)
from distalock.client.events import Event, EventLines
from distalock.client.memory import ReadMemory
from distalock.client.methods import Methods
from distalock.client.models import LoginBody, RefreshBody, SessionView
from distalock.client.session import Session

T = TypeVar("T")
_ANSWER_S: Final = 300.0


class Client(Methods):
    """A gateway, as one console sees it; threads may share it.

    It quotes in `If-Match` what it has read last, renews its session by itself, and does not fetch again what has not
    changed. It never sends an action twice: to repeat one whose answer was lost, call again with the same
    `idempotency_key`.

    Parameters
    ----------
    base_url
        As `https://gateway:8000`.
    token
        An access token that is there already, as the simulation's; otherwise `log_in`.
    answer_s
        How long an answer may take.
    http
        A prepared connection, as with a hospital's own certificates; the client does not close it.
    """

    def __init__(
        self, base_url: str, token: str | None = None, answer_s: float = _ANSWER_S, http: httpx.Client | None = None
    ) -> None:
        self._http = http or httpx.Client(timeout=timeout(answer_s))
        self._owns_http = http is None
        self._base_url = base_url.rstrip("/")
        self._session = Session(access_token=token)
        self._read = ReadMemory()
        self._renewing, self._remembering = threading.Lock(), threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give up the connection; the session goes on, see `log_out`."""
        if self._owns_http:
            self._http.close()

    def log_in(self, name: str, password: str) -> SessionView:
        """Sign in, and be signed in with every request from now on; raises `RequestRefused`."""
        return self._signed_in(self.sign_in(LoginBody(name=name, password=password)))

    def log_out(self) -> None:
        """End the session; raises `RequestRefused`."""
        self.sign_out()
        self._session = Session()

    @property
    def base_url(self) -> str:
        """Where the gateway is."""
        return self._base_url

    @property
    def session_headers(self) -> dict[str, str]:
        """What says who asks, for requests that this client does not make, as `WS /live`."""
        return self._session.headers

    def etag(self, path: str) -> str | None:
        """ETag of a path, as `/api/v1/cases/{id}`, as it was read last; None when it was not."""
        return self._read.etags.get(path)

    def send(self, call: Call[T]) -> T:
        """What is answered to a call.

        Raises
        ------
        RequestRefused
            When the gateway refuses it.
        AnswerInvalid
            When the answer is none that the interface documents.
        httpx.TransportError
            When there is no connection, or it breaks.
        """
        self._renew_if_due(call.path)
        url = str(httpx.URL(self._base_url + call.path, params=list(call.query) or None))
        with self._remembering:
            headers = {**self._session.headers, **call.headers(self._read.etags), **self._read.conditions(call, url)}
        answer = self._answer(call, url, headers)
        refusal = answer.refusal(call.path)
        if refusal is not None:
            raise refusal
        with self._remembering:
            content = self._read.content(call, url, answer)
        return call.answered(content)

    def events(self, after: int | None = None) -> Generator[Event, None, None]:
        """Every event that comes, or since `after`; goes on where it was when the connection breaks.

        Raises
        ------
        httpx.TransportError
            When it breaks before the first event and there is no `after`: events would be lost without a sign.
        """
        return self._events("/api/v1/events", after)

    def case_events(self, case_id: str, after: int = 0) -> Generator[Event, None, None]:
        """The events of a case, from its beginning or since `after`."""
        return self._events(f"/api/v1/cases/{escaped(case_id)}/events", after)

    def _answer(self, call: Call[T], url: str, headers: dict[str, str]) -> RawAnswer:
        return raw_answer(self._http.request(call.method, url, content=call.content, headers=headers))

    def _renew_if_due(self, path: str) -> None:
        """Renew before access ends; one thread does it, for a refresh token is good once."""
        if not self._session.must_be_renewed(path, time.monotonic):
            return
        with self._renewing:
            if self._session.must_be_renewed(path, time.monotonic):
                self._signed_in(
                    self.send(calls.refresh_session(RefreshBody(refresh_token=self._session.refresh_token)))
                )

    def _signed_in(self, view: SessionView) -> SessionView:
        self._session = Session.of(view, time.monotonic())
        return view

    def _events(self, path: str, after: int | None) -> Generator[Event, None, None]:
        while True:
            try:
                for event in self._connected_events(path, after):
                    after = event.sequence
                    yield event
                require_place(after)
            except httpx.TransportError:
                require_place(after)
            time.sleep(RECONNECT_AFTER_S)

    def _connected_events(self, path: str, after: int | None) -> Generator[Event, None, None]:
        self._renew_if_due(path)
        place = {} if after is None else {"Last-Event-ID": str(after)}
        headers = {**self._session.headers, **ACCEPT_EVENTS, **place}
        with self._http.stream("GET", self._base_url + path, headers=headers, timeout=STREAM_TIMEOUT) as stream:
            if stream.is_error:
                stream.read()
                refusal = raw_answer(stream).refusal(path)
                assert refusal is not None
                raise refusal
            lines = EventLines()
            for chunk in stream.iter_bytes():
                yield from lines.received(chunk)

"""Attacks on the REST interface: requests that are ambiguous, large, slow or deep, floods, forged approvals."""

import contextlib
import socket
import time
import uuid
from collections.abc import Callable, Mapping
from typing import Final

import httpx

from distalock.rest_client import bearer
from services.ui_api.front.connection import HEAD_WITHIN_S
from services.ui_api.routes.body_limit import BODY_WITHIN_S
from tests.attacks.attack import Attack, Record
from tests.attacks.site import PATIENCE_S, Site, wait_until

_LARGE_BYTES: Final = 10 * 2**20
_DEEP: Final = 100_000
_STOPS: Final = 300
_VIEWERS: Final = 20
CLOSED: Final = "connection closed"


def code_of(answer: httpx.Response) -> str:
    """The code of a problem document; the status where there is none."""
    if answer.headers.get("content-type", "").startswith("application/problem+json"):
        return str(answer.json()["code"])
    return str(answer.status_code)


def request_to(
    method: str, path: str, headers: Mapping[str, str] | None = None, content: bytes = b"{}"
) -> Callable[[Site], str]:
    """A request to the API by somebody who is signed in; the path is sent as it stands."""

    def run(site: Site) -> str:
        own = {
            "Idempotency-Key": uuid.uuid4().hex,
            "Content-Type": "application/json",
            "If-Match": site.case.etag(),
            **bearer(site.installation.token),
        }
        where = httpx.URL(site.installation.ports.rest_url, raw_path=_path(path, site).encode())
        return code_of(httpx.request(method, where, headers={**own, **(headers or {})}, content=content, timeout=60.0))

    return run


def _path(path: str, site: Site) -> str:
    return "/api/v1" + path.format(case=site.case.id, plan=site.plan.number)


def raw(sent: str) -> Callable[[Site], str]:
    """Bytes on a connection; the status of each answer until it is closed."""

    def run(site: Site) -> str:
        with _connection(site) as connection:
            connection.sendall(sent.format(case=site.case.id).encode())
            return _statuses(connection)

    return run


def _connection(site: Site) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", site.installation.ports.rest))
    connection.settimeout(PATIENCE_S)
    return connection


def _statuses(connection: socket.socket) -> str:
    received = b""
    try:
        while chunk := connection.recv(65536):
            received += chunk
    except ConnectionError:
        pass  # it was closed with something unread
    found = [line.split()[1] for line in received.decode().splitlines() if line.startswith("HTTP/1.1 ")]
    return " ".join(found) or CLOSED


def _slow_head(site: Site) -> str:
    with _connection(site) as connection:
        connection.sendall(b"POST /api/v1/cases HTTP/1.1\r\nHost: loc")
        began_s = time.monotonic()
        answered = _statuses(connection)
    return answered if time.monotonic() - began_s > HEAD_WITHIN_S / 2.0 else "at once"


def _slow_upload(site: Site) -> str:
    head = (
        "POST /api/v1/cases HTTP/1.1\r\nHost: localhost\r\nIdempotency-Key: slow\r\nContent-Type: application/json\r\n"
        f"Content-Length: 4000000\r\nAuthorization: Bearer {site.installation.token}\r\n\r\n"
    )
    with _connection(site) as connection:
        connection.sendall(head.encode())
        deadline_s = time.monotonic() + 3.0 * BODY_WITHIN_S
        connection.settimeout(0.5)
        while time.monotonic() < deadline_s:
            try:
                connection.sendall(b" ")
                answer = connection.recv(65536)
            except TimeoutError:
                continue
            return "body_too_slow" if b'"code":"body_too_slow"' in answer + _rest(connection) else "answered"
    return "waited for"


def _rest(connection: socket.socket) -> bytes:
    """What is left of an answer that comes in pieces, until the other side closes or says no more."""
    rest = b""
    with contextlib.suppress(OSError):
        while piece := connection.recv(65536):
            rest += piece
    return rest


def _stop_flood(site: Site) -> str:
    """Stops without end; each must be confirmed, and the robot must not leave its place."""
    with httpx.Client(base_url=site.installation.ports.rest_url, timeout=60.0) as client:
        answers = [client.post("/api/v1/robot/stop") for _ in range(_STOPS)]
    refused = [answer for answer in answers if answer.status_code != httpx.codes.OK or not answer.json()["confirmed"]]
    return "every stop confirmed" if not refused else f"{len(refused)} stops not confirmed: {refused[0].text}"


def _viewers_that_never_read(site: Site) -> str:
    """Event streams from the beginning of the log that nobody takes, while others are served."""
    opened = [_connection(site) for _ in range(_VIEWERS)]
    try:
        for viewer in opened:
            viewer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
            viewer.sendall(
                "GET /api/v1/events?after=0 HTTP/1.1\r\nHost: localhost\r\n"
                f"Authorization: Bearer {site.installation.token}\r\n\r\n".encode()
            )
        wait_until(lambda: site.robot()["state"] in ("locked", "stopped"), "the robot's state", PATIENCE_S)
        return "others are served"
    finally:
        for viewer in opened:
            viewer.close()


def gateway_log(text: str) -> Record:
    return Record("ui_api", text)


PORT: Final = "a token of somebody who may do everything"
_POST: Final = (
    "POST /api/v1/cases HTTP/1.1\r\nHost: localhost\r\nIdempotency-Key: 1\r\nContent-Type: application/json\r\n"
)

_UNREADABLE: Final = Record("ui_api-front", "request refused: request_invalid")

ATTACKS: Final = (
    Attack(
        "no host",
        PORT,
        "a request without a Host header",
        "400",
        _UNREADABLE,
        raw("GET /api/v1/cases HTTP/1.1\r\n\r\n"),
    ),
    Attack(
        "header smuggling",
        PORT,
        "Content-Length and Transfer-Encoding, a motion behind the first request",
        "400",
        gateway_log("ambiguous_length"),
        raw(
            _POST + "Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
            "POST /api/v1/cases/{case}/motions HTTP/1.1\r\nHost: localhost\r\nIdempotency-Key: 2\r\n"
            'Content-Type: application/json\r\nContent-Length: 11\r\n\r\n{{"plan": 1}}'
        ),
    ),
    Attack(
        "two lengths",
        PORT,
        "two Content-Length headers that differ",
        "400",
        _UNREADABLE,
        raw(_POST + "Content-Length: 2\r\nContent-Length: 60\r\n\r\n{{}}"),
    ),
    Attack(
        "space in a header",
        PORT,
        "`Content-Length : 2`, which some readers ignore",
        "400",
        _UNREADABLE,
        raw(_POST + "Content-Length : 2\r\n\r\n{{}}"),
    ),
    Attack(
        "large body",
        PORT,
        "a body of 10 MiB",
        "body_too_large",
        gateway_log("body_too_large"),
        request_to("POST", "/cases", content=b" " * _LARGE_BYTES),
    ),
    Attack(
        "deep body",
        PORT,
        f"JSON of {_DEEP} nested lists",
        "request_refused",
        gateway_log("request_refused"),
        request_to("POST", "/cases", content=b"[" * _DEEP + b"]" * _DEEP),
    ),
    Attack(
        "compressed body",
        PORT,
        "a gzip body, so that it grows here",
        "request_refused",
        gateway_log("request_refused"),
        request_to("POST", "/cases", {"Content-Encoding": "gzip"}, bytes.fromhex("1f8b0800000000000003")),
    ),
    Attack(
        "slow head",
        PORT,
        "a request whose head never ends",
        CLOSED,
        Record("ui_api-front", "head_too_slow"),
        _slow_head,
    ),
    Attack(
        "slow upload",
        PORT,
        "a body of one byte every half second",
        "body_too_slow",
        gateway_log("body_too_slow"),
        _slow_upload,
    ),
    Attack(
        "unapproved plan",
        PORT,
        "start a motion from a plan that does not exist",
        "plan_not_found",
        gateway_log("plan_not_found"),
        request_to("POST", "/cases/{case}/motions", content=b'{"plan": 99}'),
    ),
    Attack(
        "forged approval",
        PORT,
        "approve the plan under another hash",
        "plan_hash_mismatch",
        gateway_log("plan_hash_mismatch"),
        request_to("POST", "/cases/{case}/plans/{plan}/approval", {"If-Match": f'"{"0" * 64}"'}, b"{}"),
    ),
    Attack(
        "viewers that never read",
        PORT,
        f"{_VIEWERS} event streams that nobody takes",
        "others are served",
        None,
        _viewers_that_never_read,
    ),
)

STOP_FLOOD: Final = Attack(
    "stop flood",
    PORT,
    f"{_STOPS} stops, one after the other",
    "every stop confirmed",
    Record("case-record", "stop_requested"),
    _stop_flood,
)

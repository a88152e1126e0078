"""Heads on their way through the front."""

import h11
import pytest

from services.ui_api.front.heads import AnswerFraming, answer_head, forwarded, is_stop, is_upgrade, stays_open


def request(head: str) -> h11.Request:
    parser = h11.Connection(h11.SERVER)
    parser.receive_data(head.replace("\n", "\r\n").encode() + b"\r\n\r\n")
    event = parser.next_event()
    assert isinstance(event, h11.Request)
    return event


@pytest.mark.parametrize(
    ("line", "stops"),
    [
        ("POST /api/v1/robot/stop", True),
        ("POST /api/v1/robot/stop?now=1", True),
        ("POST /api/v1/robot/%73top", True),
        ("POST http://gateway/api/v1/robot/stop", True),
        ("GET /api/v1/robot/stop", False),
        ("POST /api/v1/robot/stop/", False),
        ("POST /api/v1/robot/reset", False),
    ],
)
def test_a_stop_is_known_by_method_and_path(line: str, stops: object) -> None:
    assert is_stop(request(f"{line} HTTP/1.1\nhost: gateway")) is stops


def test_what_is_forwarded_says_who_asks_and_nothing_that_a_client_claims() -> None:
    head = forwarded(
        request(
            "POST /api/v1/cases HTTP/1.1\nhost: gateway\nconnection: keep-alive, x-mine\nx-mine: 1\n"
            "expect: 100-continue\n"
            "x-forwarded-for: 9.9.9.9\nforwarded: for=9.9.9.9\nidempotency-key: k\ncontent-length: 2"
        ),
        "10.0.0.7",
        "https",
    )
    assert head == (
        b"POST /api/v1/cases HTTP/1.1\r\nhost: gateway\r\nidempotency-key: k\r\ncontent-length: 2\r\n"
        b"x-forwarded-for: 10.0.0.7\r\nx-forwarded-proto: https\r\n\r\n"
    )


def test_an_upgrade_is_forwarded_as_one() -> None:
    asked = request("GET /api/v1/live HTTP/1.1\nhost: g\nconnection: Upgrade\nupgrade: websocket\nsec-websocket-key: k")
    assert is_upgrade(asked)
    assert b"\r\nupgrade: websocket\r\nsec-websocket-key: k\r\nconnection: upgrade\r\n" in forwarded(asked, "p", "http")


@pytest.mark.parametrize(
    ("head", "open_afterwards"),
    [
        ("GET / HTTP/1.1\nhost: g", True),
        ("GET / HTTP/1.1\nhost: g\nconnection: close", False),
        ("GET / HTTP/1.0\nhost: g", False),
    ],
)
def test_a_connection_stays_open_when_its_client_wants_it(head: str, open_afterwards: object) -> None:
    assert stays_open(request(head)) is open_afterwards


@pytest.mark.parametrize(
    ("head", "method", "body", "whole"),
    [
        ("HTTP/1.1 200 OK\r\ncontent-length: 3\r\n\r\n", b"GET", b"abc", True),
        ("HTTP/1.1 200 OK\r\ncontent-length: 3\r\n\r\n", b"GET", b"ab", False),
        ("HTTP/1.1 200 OK\r\ncontent-length: 3\r\n\r\n", b"HEAD", b"", True),
        ("HTTP/1.1 304 Not Modified\r\n\r\n", b"GET", b"", True),
        ("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", b"GET", b"1\r\na\r\n0\r\n\r\n", True),
        ("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", b"GET", b"1\r\na\r\n", False),
        ("HTTP/1.1 200 OK\r\n\r\n", b"GET", b"to the end of the connection", False),
    ],
)
def test_an_answer_is_whole_when_its_end_has_come(head: str, method: bytes, body: bytes, whole: object) -> None:
    framing = AnswerFraming.of(head.encode(), method)
    for place in range(len(body)):
        framing.take(body[place : place + 1])
    assert framing.whole is whole


def test_the_clients_own_connection_is_what_an_answer_speaks_of() -> None:
    head = b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\nConnection: close\r\n\r\n"
    assert answer_head(head, keeps_open=True) == b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\n\r\n"
    assert answer_head(head, keeps_open=False) == b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"

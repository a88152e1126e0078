"""Connections to the application are used again, and one that it has closed meanwhile loses no request."""

import socket
import threading
import time

import pytest

from services.ui_api.front import connection
from services.ui_api.front.admission import Limits
from services.ui_api.front.heads import AnswerFraming
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.front.rig import GET, STOP, answer_of, front

ANSWER = b"HTTP/1.1 200 OK\r\ncontent-length: 2\r\n\r\n{}"
LAST = b"HTTP/1.1 200 OK\r\ncontent-length: 2\r\nconnection: close\r\n\r\n{}"
POST = b"POST /api/v1/cases HTTP/1.1\r\nhost: g\r\ncontent-length: 2\r\n\r\n{}"


class Counting:
    """An application that answers so many requests on each connection, and then ends it: at once, or with the next."""

    def __init__(
        self, answers: int, answer: bytes = ANSWER, *, hears_one_more: bool = False, reads_body: bool = True
    ) -> None:
        self.answers, self.answer, self.hears_one_more = answers, answer, hears_one_more
        self.reads_body = reads_body
        self.connections = 0
        self.closed = threading.Semaphore(0)

    def __call__(self, connection: socket.socket) -> None:
        self.connections += 1
        for _ in range(self.answers):
            content = b""
            while not self._is_whole(content):
                piece = connection.recv(65536)
                if not piece:
                    return
                content += piece
            connection.sendall(self.answer)
        if self.hears_one_more:
            connection.recv(65536)
        connection.close()
        self.closed.release()

    def _is_whole(self, content: bytes) -> bool:
        head, end, body = content.partition(b"\r\n\r\n")
        return bool(end) and (not self.reads_body or not head.startswith(b"POST") or body == b"{}")


def test_requests_share_a_connection_to_the_application() -> None:
    application = Counting(answers=100)
    with front(application) as rig, rig.connect() as client:
        for _ in range(3):
            client.sendall(GET)
            assert answer_of(client) == ANSWER
            client.sendall(POST)
            assert answer_of(client) == ANSWER
    assert application.connections == 1


def test_a_connection_is_not_used_again_when_the_application_says_so() -> None:
    application = Counting(answers=100, answer=LAST)
    with front(application) as rig, rig.connect() as client:
        for _ in range(3):
            client.sendall(GET)
            assert answer_of(client) == ANSWER
    assert application.connections == 3


def test_what_only_reads_is_asked_again_where_the_connection_is_closed_meanwhile() -> None:
    application = Counting(answers=1, hears_one_more=True)
    with front(application) as rig, rig.connect() as client:
        for _ in range(3):
            client.sendall(GET)
            assert answer_of(client) == ANSWER
    assert application.connections == 3


def test_what_acts_is_not_sent_twice() -> None:
    application = Counting(answers=1, hears_one_more=True)
    with front(application) as rig, rig.connect() as client:
        client.sendall(POST)
        assert answer_of(client) == ANSWER
        client.sendall(POST)
        answer = answer_of(client)
    assert answer.startswith(b"HTTP/1.1 503 ")
    assert b"application_unavailable" in answer
    assert application.connections == 1


def test_a_connection_that_has_ended_meanwhile_takes_no_request() -> None:
    """It would cost whoever acts a refusal, though nothing is wrong."""
    application = Counting(answers=1)
    with front(application) as rig, rig.connect() as client:
        for _ in range(3):
            client.sendall(POST)
            assert answer_of(client) == ANSWER
            assert application.closed.acquire(timeout=10.0)
            time.sleep(0.05)  # the front hears of it from the system, and tells nobody
    assert application.connections == 3


@pytest.mark.parametrize(("field", "keeps_open"), [("connection: close", False), ("x: y", True)])
def test_an_answer_says_whether_its_connection_goes_on(field: str, keeps_open: object) -> None:
    head = f"HTTP/1.1 204 No Content\r\n{field}\r\n\r\n".encode()
    assert AnswerFraming.of(head, b"GET").keeps_open is keeps_open


def test_an_answer_before_the_body_announces_that_the_connection_ends() -> None:
    """A client that is not warned sends its next request into a connection that is being closed."""
    head, _, _ = POST.partition(b"{}")
    application = Counting(answers=100, reads_body=False)
    with front(application) as rig, rig.connect() as client:
        client.sendall(head)
        assert b"connection: close" in answer_of(client)
        assert client.recv(1) == b""
    with front(application) as rig, rig.connect() as client:
        client.sendall(POST)
        assert answer_of(client) == ANSWER
    assert application.connections == 2, "what was refused early left a connection that nobody uses again"


def test_who_is_answered_before_the_body_may_still_send_it() -> None:
    """A connection that is closed on what still comes is reset, and the client may lose the answer with it."""
    head, _, _ = POST.partition(b"{}")
    with front(Counting(answers=1, reads_body=False)) as rig, rig.connect() as client:
        client.sendall(head)
        answer_of(client)
        assert client.recv(1) == b""
        for piece in (b"{", b"}"):
            client.sendall(piece)
            time.sleep(0.05)  # a reset comes back meanwhile


def test_who_was_answered_and_still_sends_keeps_no_place_that_another_needs() -> None:
    head, _, _ = POST.partition(b"{}")
    application = Counting(answers=1, reads_body=False)
    with front(application, Limits(connections=1, relays=1)) as rig, rig.connect() as client:
        client.sendall(head)
        answer_of(client)
        with rig.connect() as another:
            another.sendall(STOP)
            assert answer_of(another).startswith(b"HTTP/1.1 200 ")
        assert rig.admission.closed_idle == 1


def test_who_goes_on_sending_after_the_answer_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "_REST_WITHIN_S", 0.1)
    head, _, _ = POST.replace(b"length: 2", b"length: 9999").partition(b"{}")
    with front(Counting(answers=1, reads_body=False)) as rig, rig.connect() as client:
        client.sendall(head)
        answer_of(client)
        with pytest.raises(OSError, match=r"reset|Broken pipe"):  # noqa: PT012 - the system tells with one of the next
            for _ in range(int(PATIENCE_S / 0.05)):
                client.sendall(b"x")
                time.sleep(0.05)

"""A gateway that leaves answers what it has begun, refuses what is new, and stops."""

import socket
import threading

from services.ui_api.routes.problems import Problem
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.front.rig import GET, STOP, answer_of, front

OK = b"HTTP/1.1 200 OK\r\ncontent-length: 2\r\nconnection: close\r\n\r\n{}"
POST = b"POST /api/v1/cases HTTP/1.1\r\nhost: g\r\ncontent-length: 2\r\n\r\n{}"


class Slow:
    """An application that answers when it is told to."""

    def __init__(self) -> None:
        self.asked, self.release = threading.Semaphore(0), threading.Event()

    def __call__(self, connection: socket.socket) -> None:
        connection.recv(65536)
        self.asked.release()
        assert self.release.wait(PATIENCE_S)
        connection.sendall(OK)


def test_what_has_begun_is_answered_and_what_is_new_refused() -> None:
    application = Slow()
    with front(application) as rig, rig.connect() as begun, rig.connect() as idle:
        begun.sendall(POST)
        assert application.asked.acquire(timeout=PATIENCE_S)
        rig.leaving.begin()
        for request in (GET, POST):
            with rig.connect() as late:
                late.sendall(request)
                head, _, body = answer_of(late).partition(b"\r\n\r\n")
                assert head.startswith(b"HTTP/1.1 503 ")
                assert b"retry-after: 5" in head.lower().split(b"\r\n")
                assert Problem.model_validate_json(body).code == "gateway_leaving"
        idle.sendall(GET)  # on a connection from before
        assert b"gateway_leaving" in answer_of(idle)
        application.release.set()
        assert answer_of(begun)[-2:] == b"{}"
    assert not application.asked.acquire(blocking=False), "nothing new reached the application"


def test_a_stop_is_sent_all_the_same() -> None:
    with front(Slow()) as rig:
        rig.leaving.begin()
        with rig.connect() as client:
            client.sendall(STOP)
            assert rig.stopped.acquire(timeout=PATIENCE_S)
            rig.record(next(rig.heard_by_application()).number)
            assert answer_of(client).startswith(b"HTTP/1.1 200 ")

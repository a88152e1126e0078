"""The public port: a stop goes out whatever everybody else does, and everything else reaches the application."""

import json
import socket
import threading
import time

import pytest

from services.ui_api.front.admission import Limits
from services.ui_api.front.answers import Asked, problem_answer
from services.ui_api.front.handover import Handover
from services.ui_api.routes.motion_views import StopView
from services.ui_api.routes.problems import Problem
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.front.rig import GET, STOP, answer_of, front
from tests.unit.services.ui_api.room import wait_until

OK = b"HTTP/1.1 200 OK\r\ncontent-length: 2\r\nconnection: close\r\n\r\n{}"


def answers(connection: socket.socket) -> None:
    """An application that reads a head and answers."""
    content = b""
    while b"\r\n\r\n" not in content:
        content += connection.recv(65536)
    connection.sendall(OK)


class Hanging:
    """An application that answers nothing before `release`."""

    def __init__(self) -> None:
        self.asked = threading.Semaphore(0)
        self.release = threading.Event()

    def __call__(self, connection: socket.socket) -> None:
        connection.recv(65536)
        self.asked.release()
        self.release.wait(PATIENCE_S)
        connection.sendall(OK)


def test_requests_follow_one_another_on_one_connection() -> None:
    with front(answers) as rig, rig.connect() as client:
        for _ in range(3):
            client.sendall(GET)
            assert answer_of(client) == OK.replace(b"connection: close\r\n", b"")
        client.sendall(GET * 2)
        assert [answer_of(client)[-2:] for _ in range(2)] == [b"{}", b"{}"]


def test_what_follows_a_request_that_states_its_length_twice_is_not_taken_for_a_request() -> None:
    asked: list[bytes] = []

    def counting(connection: socket.socket) -> None:
        asked.append(connection.recv(65536))
        connection.sendall(OK)

    twice = b"POST /x HTTP/1.1\r\nHost: a\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
    with front(counting) as rig, rig.connect() as client:
        client.sendall(twice + GET)
        received = b""
        while content := client.recv(65536):
            received += content
    assert received.count(b"HTTP/1.1 200") == len(asked) == 1
    assert b"connection: close" in received


@pytest.mark.requirement("GW-05")
def test_a_stop_goes_out_and_is_answered_while_the_application_hangs() -> None:
    hanging = Hanging()
    with front(hanging, Limits(connections=100, relays=30)) as rig:
        waiting = [rig.connect() for _ in range(40)]  # more than the application may work on
        for client in waiting:
            client.sendall(GET)
        for _ in range(30):
            assert hanging.asked.acquire(timeout=PATIENCE_S)
        with rig.connect() as client:
            client.sendall(STOP)
            assert rig.stopped.acquire(timeout=PATIENCE_S)
            answer = answer_of(client)
        body = json.loads(answer.partition(b"\r\n\r\n")[2])
        assert StopView.model_validate(body) == StopView(confirmed=True, state="stopped", detail="", recorded=False)
        assert len(rig.stops) == 1, "it is kept until the application has recorded it"
        hanging.release.set()
        for client in waiting:
            client.close()


def test_a_stop_says_recorded_when_the_application_has_said_so() -> None:
    with front(answers) as rig, rig.connect() as client:
        client.sendall(STOP)
        ended = next(rig.heard_by_application())
        assert (ended.reason, ended.who, ended.confirmed) == ("stop requested over REST", "rest", True)
        rig.record(ended.number)
        assert json.loads(answer_of(client).partition(b"\r\n\r\n")[2])["recorded"] is True
        assert len(rig.stops) == 0


def test_a_stop_that_was_sent_ahead_on_a_busy_connection_goes_out_at_once() -> None:
    hanging = Hanging()
    with front(hanging) as rig, rig.connect() as client:
        client.sendall(GET)
        assert hanging.asked.acquire(timeout=PATIENCE_S)
        client.sendall(STOP)
        assert rig.stopped.acquire(timeout=PATIENCE_S), "it waited for the answer before it"
        hanging.release.set()
        assert answer_of(client).endswith(b"{}")
        assert b'"confirmed":true' in answer_of(client)
        assert not rig.stopped.acquire(blocking=False), "it went out once"


@pytest.mark.parametrize("before", [1, 3])
def test_a_stop_in_the_same_piece_as_what_goes_before_it_goes_out_at_once(before: int) -> None:
    hanging = Hanging()
    with front(hanging) as rig, rig.connect() as client:
        client.sendall(GET * before + STOP)
        assert rig.stopped.acquire(timeout=PATIENCE_S), "it waited for the answer before it"
        hanging.release.set()
        for _ in range(before):
            assert answer_of(client).endswith(b"{}")
        assert b'"confirmed":true' in answer_of(client)
        assert not rig.stopped.acquire(blocking=False), "it went out once"


def test_a_body_that_reads_like_a_stop_is_none() -> None:
    hanging = Hanging()
    with front(hanging) as rig, rig.connect() as client:
        client.sendall(b"POST /api/v1/cases HTTP/1.1\r\nhost: g\r\ncontent-length: %d\r\n\r\n" % (2 * len(STOP)))
        assert hanging.asked.acquire(timeout=PATIENCE_S)
        client.sendall(STOP)
        client.sendall(STOP)
        hanging.release.set()
        answer_of(client)
        assert not rig.stopped.acquire(blocking=False)


def test_a_head_that_is_met_again_is_the_same_request_and_no_other() -> None:
    asked: list[bytes] = []

    def noting(connection: socket.socket) -> None:
        asked.append(connection.recv(65536))
        connection.sendall(OK)

    other = GET.replace(b"cases", b"parts")
    with front(noting) as rig, rig.connect() as client:
        for sent in (GET, GET, other, GET):
            client.sendall(sent)
            answer_of(client)
        client.sendall(GET[:20])
        time.sleep(0.05)
        client.sendall(GET[20:])
        answer_of(client)
        client.sendall(GET[20:])
        assert answer_of(client).startswith(b"HTTP/1.1 400 "), "half a head is none"
    targets = [head.split(b" ", 2)[1] for head in asked]
    assert [target.rpartition(b"/")[2] for target in targets] == [b"cases"] * 2 + [b"parts"] + [b"cases"] * 2


def test_who_reads_slowly_slows_his_own_answer_alone() -> None:
    sent: list[int] = []
    piece, size = b"x" * 65536, 256

    def pours(connection: socket.socket) -> None:
        connection.recv(65536)
        connection.sendall(b"HTTP/1.1 200 OK\r\ncontent-length: %d\r\n\r\n" % (size * len(piece)))
        for _ in range(size):
            connection.sendall(piece)
            sent.append(len(piece))

    with front(pours) as rig, rig.connect() as client:
        client.sendall(GET)
        wait_until(lambda: bool(sent))
        before = -1
        while before != len(sent):  # until nothing more is taken
            before = len(sent)
            time.sleep(0.2)
        assert len(sent) < size, "the front took all of an answer that nobody reads"
        with rig.connect() as other:
            other.sendall(STOP)
            assert rig.stopped.acquire(timeout=PATIENCE_S)
        assert len(answer_of(client)) > size * len(piece)


def test_who_reads_nothing_does_not_hold_a_place_for_ever() -> None:
    ended = threading.Event()

    def pours(connection: socket.socket) -> None:
        connection.recv(65536)
        connection.sendall(b"HTTP/1.1 200 OK\r\ncontent-length: %d\r\n\r\n" % 2**30)
        try:
            while True:
                connection.sendall(bytes(65536))
        except OSError:
            ended.set()

    with front(pours, reads_within_s=0.2) as rig, rig.connect() as client:
        client.sendall(GET)
        assert ended.wait(PATIENCE_S)
        wait_until(lambda: rig.admission.relays == 0)


def test_a_stop_from_outside_the_room_is_the_applications_business() -> None:
    hanging = Hanging()
    with front(hanging, room_networks=()) as rig, rig.connect() as client:
        client.sendall(GET)
        assert hanging.asked.acquire(timeout=PATIENCE_S)
        client.sendall(STOP)
        hanging.release.set()
        assert answer_of(client).endswith(b"{}")
        assert hanging.asked.acquire(timeout=PATIENCE_S), "the application gets it, in its turn"
        assert answer_of(client).endswith(b"{}")
        assert not rig.stopped.acquire(blocking=False), "the front, which knows no users, sends nothing"


def test_idle_connections_make_room_for_a_stop() -> None:
    with front(answers, Limits(connections=20, relays=5)) as rig:
        idle = [rig.connect() for _ in range(60)]
        with rig.connect() as client:
            client.sendall(STOP)
            assert rig.stopped.acquire(timeout=PATIENCE_S)
        assert idle[0].recv(1) == b"", "the one that was idle the longest was closed"
        assert rig.admission.closed_idle >= 40
        for connection in idle:
            connection.close()


def test_a_connection_that_asks_for_nothing_is_closed() -> None:
    with front(answers, head_within_s=0.1) as rig:
        for sent in (b"", b"GET / HT", GET):
            with rig.connect() as client:
                client.sendall(sent)
                if sent == GET:
                    answer_of(client)
                assert client.recv(1) == b""


def test_requests_beyond_the_bound_are_told_to_come_again() -> None:
    hanging = Hanging()
    with front(hanging, Limits(connections=20, relays=1)) as rig, rig.connect() as first, rig.connect() as second:
        first.sendall(GET)
        assert hanging.asked.acquire(timeout=PATIENCE_S)
        second.sendall(GET)
        head, _, body = answer_of(second).partition(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 503 ")
        assert b"\r\nretry-after: 1" in head
        assert Problem.model_validate_json(body).code == "gateway_busy"
        hanging.release.set()
        assert answer_of(first).endswith(b"{}")


def test_an_application_that_is_not_there_is_said_so() -> None:
    with front(lambda connection: connection.close()) as rig, rig.connect() as client:
        client.sendall(GET)
        problem = Problem.model_validate_json(answer_of(client).partition(b"\r\n\r\n")[2])
        assert (problem.status, problem.code) == (503, "application_unavailable")


def test_a_client_that_leaves_ends_its_request() -> None:
    asked, left = threading.Event(), threading.Event()

    def waits(connection: socket.socket) -> None:
        connection.recv(65536)
        asked.set()
        if connection.recv(1) == b"":
            left.set()

    with front(waits) as rig:
        with rig.connect() as client:
            client.sendall(GET)
            assert asked.wait(PATIENCE_S)
        assert left.wait(PATIENCE_S)


def test_an_answer_that_breaks_off_ends_the_connection() -> None:
    def breaks_off(connection: socket.socket) -> None:
        connection.recv(65536)
        connection.sendall(b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n1\r\na\r\n")

    with front(breaks_off) as rig, rig.connect() as client:
        client.sendall(GET)
        content = b""
        while piece := client.recv(65536):
            content += piece
        assert content.endswith(b"1\r\na\r\n")


def test_a_refusal_arrives_although_the_body_was_not_read() -> None:
    def refuses(connection: socket.socket) -> None:
        connection.recv(16)
        connection.sendall(b"HTTP/1.1 413 Too Large\r\ncontent-length: 0\r\n\r\n")

    with front(refuses) as rig, rig.connect() as client:
        client.sendall(b"POST /api/v1/cases HTTP/1.1\r\nhost: g\r\ncontent-length: 10\r\n\r\n")
        assert answer_of(client).startswith(b"HTTP/1.1 413 ")


@pytest.mark.parametrize("framing", ["chunked", "length"])
def test_a_body_arrives_whole(framing: str) -> None:
    chunked = framing == "chunked"
    received: list[bytes] = []
    sent = b"x" * 300_000

    def reads(connection: socket.socket) -> None:
        content = b""
        end = b"0\r\n\r\n" if chunked else sent
        while not content.endswith(end):
            content += connection.recv(65536)
        received.append(content.partition(b"\r\n\r\n")[2])
        connection.sendall(OK)

    field = b"transfer-encoding: chunked" if chunked else b"content-length: %d" % len(sent)
    body = b"%x\r\n%s\r\n0\r\n\r\n" % (len(sent), sent) if chunked else sent
    with front(reads) as rig, rig.connect() as client:
        client.sendall(b"POST /api/v1/cases HTTP/1.1\r\nhost: g\r\n" + field + b"\r\n\r\n" + body)
        assert answer_of(client).endswith(b"{}")
    assert received[0].count(b"x") == len(sent)


def test_after_an_upgrade_bytes_go_both_ways() -> None:
    def echoes(connection: socket.socket) -> None:
        head = connection.recv(65536)
        assert b"connection: upgrade" in head
        connection.sendall(b"HTTP/1.1 101 Switching Protocols\r\ncontent-length: 0\r\n\r\n")
        while content := connection.recv(65536):
            connection.sendall(content[::-1])

    upgrade = b"GET /api/v1/live HTTP/1.1\r\nhost: g\r\nconnection: upgrade\r\nupgrade: websocket\r\n\r\n"
    with front(echoes) as rig, rig.connect() as client:
        client.sendall(upgrade)
        assert answer_of(client).startswith(b"HTTP/1.1 101 ")
        for word in (b"one", b"two"):
            client.sendall(word)
            assert client.recv(65536) == word[::-1]


def test_what_cannot_be_read_is_refused() -> None:
    with front(answers) as rig, rig.connect() as client:
        client.sendall(b"NO HTTP AT ALL\r\n\r\n")
        assert answer_of(client).startswith(b"HTTP/1.1 400 ")


def test_a_problem_of_the_front_is_one_of_the_openapi_file() -> None:
    answer = problem_answer(504, "stop_not_confirmed", "why", Asked("/api/v1/robot/stop", "https", keeps_open=True))
    problem = Problem.model_validate_json(answer.partition(b"\r\n\r\n")[2])
    assert problem.title == "Gateway Timeout"
    assert b"connection: close" not in answer
    assert b"\r\nstrict-transport-security: " in answer, "as every answer of the application"


def test_a_connection_that_streams_is_handed_to_the_application_with_what_was_read_of_it() -> None:
    events = b"GET /api/v1/events HTTP/1.1\r\nhost: g\r\n\r\n"
    giving, taking = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with giving, taking, front(answers, handover=Handover(giving)) as rig, rig.connect() as client:
        client.sendall(events)
        taking.settimeout(PATIENCE_S)
        content, handles, _, _ = socket.recv_fds(taking, 65536, 1)
        assert content.startswith(b"GET /api/v1/events HTTP/1.1\r\n")
        assert b"x-forwarded-for: 127.0.0.1" in content
        with socket.socket(fileno=handles[0]) as connection:
            wait_until(lambda: rig.admission.connections == 0)
            connection.sendall(b"from the application itself")
            assert client.recv(65536) == b"from the application itself"


def test_more_streams_than_the_bound_are_refused() -> None:
    events = b"GET /api/v1/events HTTP/1.1\r\nhost: g\r\n\r\n"
    giving, taking = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with giving, taking, front(answers, Limits(connections=20, relays=3), handover=Handover(giving)) as rig:
        rig.admission.note_streams(3)  # as the application counts them
        with rig.connect() as client:
            client.sendall(events)
            assert Problem.model_validate_json(answer_of(client).partition(b"\r\n\r\n")[2]).code == "gateway_busy"

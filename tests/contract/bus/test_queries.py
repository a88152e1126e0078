"""What the bus promises about queries."""

import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from structlog.contextvars import get_contextvars

from shared.bus.port import Answer, Query
from shared.errors import BusError, InputError, NoReply
from shared.tracing import new_trace_id, traced
from tests.contract.bus.rooms import PATIENCE_S, Collector, Room, until_known


def test_answer_comes_back_whole(room: Room) -> None:
    with room.open() as asker, room.open() as server:
        server.queryable("q/echo", lambda q: Answer(q.payload[::-1], b"attached"))
        until_known(server, asker)
        assert asker.query("q/echo", b"abc", PATIENCE_S) == Answer(b"cba", b"attached")


def test_who_answers_works_for_the_trace_of_who_asks(room: Room) -> None:
    trace, seen = new_trace_id(), []

    def answer(_: Query) -> Answer:
        seen.append(get_contextvars().get("trace_id"))
        return Answer(b"")

    with room.open() as asker, room.open() as server:
        server.queryable("q/traced", answer)
        until_known(server, asker)
        asker.query("q/traced", b"", PATIENCE_S)
        with traced(trace):
            asker.query("q/traced", b"", PATIENCE_S)
        asker.query("q/traced", b"", PATIENCE_S)
    assert seen == [None, trace, None]


def test_queryable_sees_which_key_was_asked(room: Room) -> None:
    with room.open() as asker, room.open() as server:
        server.queryable("q/frames/*", lambda q: Answer(q.key.encode()))
        until_known(server, asker)
        assert asker.query("q/frames/17", b"", PATIENCE_S) == Answer(b"q/frames/17")


def test_nobody_there_is_said_at_once(room: Room) -> None:
    with room.open() as asker:
        began = time.monotonic()
        with pytest.raises(NoReply, match=r"'q/nobody' brought no answer: nobody answers it"):
            asker.query("q/nobody", b"", PATIENCE_S)
        assert time.monotonic() - began < PATIENCE_S / 2


def test_silence_ends_at_the_timeout_and_the_query_may_still_be_carried_out(room: Room) -> None:
    release = threading.Event()
    carried_out = threading.Event()

    def slow(_query: Query) -> Answer:
        release.wait(PATIENCE_S)
        carried_out.set()
        return Answer(b"late")

    with room.open() as asker, room.open() as server:
        server.queryable("q/slow", slow)
        until_known(server, asker)
        with pytest.raises(NoReply, match=r"'q/slow' brought no reply within 0\.2 s; it may have been carried out"):
            asker.query("q/slow", b"", 0.2)
        assert not carried_out.is_set()
        release.set()
        assert carried_out.wait(PATIENCE_S)


def test_own_errors_cross_as_their_sentence(room: Room) -> None:
    def refuse(_query: Query) -> Answer:
        raise InputError("pose is out of reach")

    with room.open() as asker, room.open() as server:
        server.queryable("q/refuse", refuse)
        until_known(server, asker)
        for _ in range(2):
            with pytest.raises(NoReply, match=r"^'q/refuse' was answered with an error: pose is out of reach$"):
                asker.query("q/refuse", b"", PATIENCE_S)


def test_foreign_errors_cross_with_their_kind(room: Room) -> None:
    def fail(_query: Query) -> Answer:
        raise ZeroDivisionError("by zero")

    with room.open() as asker, room.open() as server:
        server.queryable("q/fail", fail)
        until_known(server, asker)
        with pytest.raises(NoReply, match=r"answered with an error: ZeroDivisionError: by zero$"):
            asker.query("q/fail", b"", PATIENCE_S)


def test_hung_queryable_does_not_hold_up_another(room: Room) -> None:
    hung = threading.Event()
    release = threading.Event()

    def hang(_query: Query) -> Answer:
        hung.set()
        release.wait(PATIENCE_S)
        return Answer(b"")

    with room.open() as asker, room.open() as server:
        server.queryable("q/move", hang)
        server.queryable("q/stop", lambda _q: Answer(b"stopped"))
        until_known(server, asker)
        with pytest.raises(NoReply):
            asker.query("q/move", b"", 0.1)
        assert hung.is_set()
        assert asker.query("q/stop", b"", PATIENCE_S).payload == b"stopped"
        release.set()


def test_an_answer_may_come_later_and_the_next_question_does_not_wait_for_it(room: Room) -> None:
    later: dict[bytes, Future[Answer]] = {b"first": Future(), b"second": Future(), b"failed": Future()}
    asked: Collector[bytes] = Collector()

    def answer_later(query: Query) -> Future[Answer]:
        asked.add(query.payload)
        return later[query.payload]

    with room.open() as asker, room.open() as server, ThreadPoolExecutor(3) as waiting:
        server.queryable("q/later", answer_later)
        until_known(server, asker)
        answers = {name: waiting.submit(asker.query, "q/later", name, PATIENCE_S) for name in later}
        for name in later:
            asked.wait_for(name)
        later[b"second"].set_result(Answer(b"2"))
        assert answers[b"second"].result(PATIENCE_S).payload == b"2"
        later[b"first"].set_result(Answer(b"1", b"attached"))
        assert answers[b"first"].result(PATIENCE_S) == Answer(b"1", b"attached")
        later[b"failed"].set_exception(InputError("pose is out of reach"))
        with pytest.raises(NoReply, match=r"answered with an error: pose is out of reach$"):
            answers[b"failed"].result(PATIENCE_S)


def test_closed_queryable_answers_no_more(room: Room) -> None:
    with room.open() as asker, room.open() as server:
        queryable = server.queryable("q/closed", lambda _q: Answer(b"1"))
        until_known(server, asker)
        assert asker.query("q/closed", b"", PATIENCE_S).payload == b"1"
        queryable.close()
        until_known(server, asker)
        with pytest.raises(NoReply, match="brought no answer"):
            asker.query("q/closed", b"", PATIENCE_S)


def test_queries_work_again_after_the_link_was_lost(own_room: Room) -> None:
    alive: Collector[tuple[str, bool]] = Collector()
    with own_room.open() as asker, own_room.open() as server:
        server.queryable("q/again", lambda _q: Answer(b"here"))
        server.presence().declare_alive("q-alive/server")
        asker.presence().watch_alive("q-alive/*", lambda key, up: alive.add((key, up)))
        alive.wait_for(("q-alive/server", True))
        own_room.cut()
        alive.wait_for_last(("q-alive/server", False))
        with pytest.raises(NoReply):
            asker.query("q/again", b"", 0.5)
        own_room.restore()
        alive.wait_for_last(("q-alive/server", True))
        assert asker.query("q/again", b"", PATIENCE_S).payload == b"here"


def test_a_session_that_was_closed_says_so(room: Room) -> None:
    with room.open() as asker:
        pass
    with pytest.raises(BusError):
        asker.query("q/echo", b"abc", 1.0)

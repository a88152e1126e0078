"""The application process as the front has it."""

import asyncio
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from queue import Queue

from services.ui_api.front.application import ApplicationLink, ApplicationProcess, running_application
from services.ui_api.link_messages import BEATS_WITHIN_S, StopEnded
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import wait_until

MODULE = "tests.unit.services.ui_api.front.fake_application"


def a_stop(number: int, reason: str = "test") -> StopEnded:
    return StopEnded(number=number, reason=reason, who="t", confirmed=True, state=None, message="", took_s=0.0)


class Running:
    """The process, the link to it, and what was heard."""

    def __init__(self, application: ApplicationProcess, link: ApplicationLink, ended: "Queue[int]") -> None:
        self.application, self.link, self.ended = application, link, ended
        self.recorded: Queue[int] = Queue()
        link.on_recorded = self.recorded.put


@contextmanager
def running() -> Iterator[Running]:
    ended: Queue[int] = Queue()
    with running_application((), ended.put, MODULE) as application:
        link = ApplicationLink()
        here = Running(application, link, ended)
        link.tell(a_stop(1))  # before the link is there
        listening = threading.Thread(target=lambda: asyncio.run(link.run(application.line)), daemon=True)
        listening.start()
        yield here
    listening.join(PATIENCE_S)


def test_stops_are_recorded_also_those_from_before_it_was_there() -> None:
    with running() as here:
        assert here.recorded.get(timeout=PATIENCE_S) == 1
        here.link.tell(a_stop(2))
        assert here.recorded.get(timeout=PATIENCE_S) == 2
        assert here.link.listening
    assert here.application.process.returncode is not None
    assert here.ended.empty(), "it was asked to end"


def test_an_application_that_hangs_is_not_alive_until_it_goes_on() -> None:
    with running() as here:
        wait_until(here.link.is_alive)
        os.kill(here.application.process.pid, signal.SIGSTOP)
        wait_until(lambda: not here.link.is_alive())
        os.kill(here.application.process.pid, signal.SIGCONT)
        wait_until(here.link.is_alive)


def test_an_application_that_ends_by_itself_is_reported_with_its_code() -> None:
    with running() as here:
        wait_until(here.link.is_alive)
        here.link.tell(a_stop(3, "die"))
        assert here.ended.get(timeout=PATIENCE_S) == 1
        wait_until(lambda: not here.link.is_alive())


def test_an_application_is_alive_for_as_long_after_a_beat_as_the_robots_deadline_leaves() -> None:
    now_s = [0.0]
    link = ApplicationLink(lambda: now_s[0])
    assert not link.is_alive(), "before its first beat"
    link._watchdog.feed()
    now_s[0] = BEATS_WITHIN_S
    assert link.is_alive()
    now_s[0] += 0.01
    assert not link.is_alive()
    link._watchdog.feed()
    link.leave()
    assert not link.is_alive(), "a gateway that leaves may take seconds: no motion goes on meanwhile"
    assert BEATS_WITHIN_S + 0.2 <= 0.5, "with the robot's own deadline"

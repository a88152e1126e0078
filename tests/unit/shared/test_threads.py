"""An exception that leaves a thread is a fault of the process, never silence."""

import gc
import queue
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from shared.errors import InputError
from shared.threads import described, faults_go_to, report_error, report_fault, supervised, supervised_thread

PATIENCE_S = 60.0


class Listener:
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.faults: queue.Queue[str] = queue.Queue()
        self.errors: queue.Queue[tuple[str, BaseException]] = queue.Queue()

    def fail(self, message: str) -> None:
        self.faults.put(message)

    def note_error(self, place: str, error: BaseException) -> None:
        self.errors.put((place, error))


def fail_by_division() -> None:
    raise ZeroDivisionError("by zero")


def leave_the_interpreter() -> None:
    sys.exit(3)


@pytest.mark.parametrize(
    ("work", "why"), [(fail_by_division, "ZeroDivisionError: by zero"), (leave_the_interpreter, "SystemExit: 3")]
)
def test_what_leaves_a_thread_is_a_fault(work: object, why: str) -> None:
    listener = Listener()
    assert callable(work)
    with faults_go_to(listener):
        thread = supervised_thread("watch", work)
        thread.start()
        thread.join(PATIENCE_S)
    assert listener.faults.get(timeout=PATIENCE_S) == f"thread 'watch' ended with {why}"


def test_all_who_are_responsible_hear_of_a_fault() -> None:
    first, second = Listener(), Listener()
    with faults_go_to(first), faults_go_to(second):
        assert report_fault("the loop", ValueError("wrong"))
    assert first.faults.get_nowait() == second.faults.get_nowait() == "the loop ended with ValueError: wrong"


def test_without_a_listener_the_exception_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: queue.Queue[str] = queue.Queue()
    monkeypatch.setattr(threading, "excepthook", lambda args: seen.put(str(args.exc_value)))
    supervised_thread("watch", fail_by_division).start()
    assert seen.get(timeout=PATIENCE_S) == "by zero"


def test_work_for_an_executor_is_a_fault_and_its_future_keeps_the_exception() -> None:
    listener = Listener()
    with faults_go_to(listener), ThreadPoolExecutor(1) as executor:
        future = executor.submit(supervised("commands", fail_by_division))
        assert isinstance(future.exception(PATIENCE_S), ZeroDivisionError)
    assert listener.faults.get_nowait() == "thread 'commands' ended with ZeroDivisionError: by zero"


def test_an_error_that_ends_no_loop_is_no_fault() -> None:
    listener = Listener()
    error = InputError("no image")
    with faults_go_to(listener):
        report_error("handler of 'imaging/frame'", error)
    assert listener.errors.get_nowait() == ("handler of 'imaging/frame'", error)
    assert listener.faults.empty()


def test_threads_of_libraries_are_noticed() -> None:
    listener = Listener()
    with faults_go_to(listener):
        thread = threading.Thread(target=fail_by_division, name="library")
        thread.start()
        thread.join(PATIENCE_S)
    place, error = listener.errors.get(timeout=PATIENCE_S)
    assert (place, str(error)) == ("thread 'library'", "by zero")


class _Wreck:
    def __del__(self) -> None:
        fail_by_division()


def test_finalisers_are_noticed() -> None:
    listener = Listener()
    with faults_go_to(listener):
        _Wreck()
        gc.collect()
    _, error = listener.errors.get(timeout=PATIENCE_S)
    assert str(error) == "by zero"


def test_hooks_are_given_back() -> None:
    before = (threading.excepthook, sys.unraisablehook)
    with faults_go_to(Listener()):
        assert threading.excepthook is not before[0]
    assert (threading.excepthook, sys.unraisablehook) == before


def test_an_error_is_described_in_one_line() -> None:
    assert described(ValueError("two\n lines")) == "ValueError: two lines"
    assert described(ValueError()) == "ValueError"

"""Threads under one supervisor: an exception that leaves a thread's work is a fault of the process, never silence.

`supervised_thread` makes a long-lived thread, `supervised` wraps work for a timer or an executor. What they raise goes
to whoever listens to the process's faults (`faults_go_to`); in a service that is its `Runtime`, which stops the robot
where there is one, logs, and ends the process with an error code. Where nobody listens, in a program without a runtime,
the exception goes on to `threading.excepthook`.

An error that ends no loop of ours is reported by `report_error`: a handler on the bus that raised, a thread of a
library, a finaliser. It is logged and counted, and the listener decides what it means for its service.
"""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import ParamSpec, Protocol, TypeVar

import structlog

from shared.errors import DistalockError

P = ParamSpec("P")
R = TypeVar("R")

_log = structlog.get_logger("distalock.threads")


class FaultListener(Protocol):
    """Who is responsible for the process."""

    def fail(self, message: str) -> None:
        """A loop of the process has ended by an exception: the process must end."""

    def note_error(self, place: str, error: BaseException) -> None:
        """One piece of work brought an exception; the loop that it came from goes on."""


_listeners: list[FaultListener] = []
_changing = threading.Lock()


def supervised(name: str, work: Callable[P, R]) -> Callable[P, R]:
    """The same work, whose exceptions are faults; they are raised all the same, for a future to keep."""

    @wraps(work)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return work(*args, **kwargs)
        except BaseException as error:  # SystemExit too: it would end the thread without a trace
            report_fault(f"thread '{name}'", error)
            raise

    return run


def supervised_thread(name: str, work: Callable[[], object]) -> threading.Thread:
    """A thread, not started yet, whose exceptions are faults. It does not keep the process from ending."""

    def run() -> None:
        try:
            work()
        except BaseException as error:
            if not report_fault(f"thread '{name}'", error):
                raise

    return threading.Thread(target=run, name=name, daemon=True)


def report_fault(place: str, error: BaseException) -> bool:
    """Log a fault and report it to all listeners; False when there is none."""
    _logged("fault", place, error)
    listeners = tuple(_listeners)
    for listener in listeners:
        listener.fail(f"{place} ended with {described(error)}")
    return bool(listeners)


def report_error(place: str, error: BaseException) -> None:
    """Log an error that ends no loop, and report it to all listeners; one of our own refusals needs no traceback."""
    if isinstance(error, DistalockError):
        _log.warning("refused", place=place, detail=described(error))
    else:
        _logged("error", place, error)
    for listener in tuple(_listeners):
        listener.note_error(place, error)


def described(error: BaseException) -> str:
    """An error in one line: its kind and its text."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


@contextmanager
def faults_go_to(listener: FaultListener) -> Iterator[None]:
    """Report the process's faults to a listener for as long as the context lasts, those of libraries' threads too."""
    with _changing:
        _listeners.append(listener)
        if len(_listeners) == 1:
            _install_hooks()
    try:
        yield
    finally:
        with _changing:
            _listeners.remove(listener)
            if not _listeners:
                _restore_hooks()


def _logged(event: str, place: str, error: BaseException) -> None:
    _log.error(event, place=place, detail=described(error), exc_info=error)


_hooks_before = (threading.excepthook, sys.unraisablehook)


def _install_hooks() -> None:
    global _hooks_before  # noqa: PLW0603 - the hooks are the process's, and so is what was there before
    _hooks_before = (threading.excepthook, sys.unraisablehook)
    threading.excepthook, sys.unraisablehook = _on_thread_exception, _on_unraisable


def _restore_hooks() -> None:
    threading.excepthook, sys.unraisablehook = _hooks_before


def _on_thread_exception(args: threading.ExceptHookArgs) -> None:
    """The net below `supervised_thread`: a thread that a library started."""
    name = "unknown" if args.thread is None else args.thread.name
    report_error(f"thread '{name}'", args.exc_value or RuntimeError(args.exc_type.__name__))


def _on_unraisable(args: "sys.UnraisableHookArgs") -> None:
    """An exception where nobody can catch it: in a finaliser, or in a callback from compiled code."""
    place = args.err_msg or f"a finaliser or callback of {type(args.object).__name__}"
    report_error(place, args.exc_value or RuntimeError(args.exc_type.__name__))

"""From start to end of a service's process.

`service_main` (or `run_service`, when the settings are there already) is what a service's `__main__` calls. A process
that is run by something else (uvicorn) uses `open_service` instead, which leaves signals alone.
"""

import os
import secrets
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final, TypeVar

import structlog

from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.bus.settings import BusSettings
from shared.bus.shared_memory import MemoryLimits
from shared.bus.zenoh_bus import open_bus
from shared.errors import BusUnavailable, ConfigurationError, DistalockError
from shared.memory import share_arenas
from shared.messages.presence import ServiceName
from shared.runtime.bus_check import check_bus
from shared.runtime.health import HealthFile
from shared.runtime.help import service_parser
from shared.runtime.impairments import watched
from shared.runtime.logging import Log, configure_logging, flush_logs
from shared.runtime.presence import StatusReporter, always, beating, nothing
from shared.runtime.settings import ServiceSettings, bus_settings, load_settings
from shared.runtime.sole_service import sole_service
from shared.scheduling import has_precedence
from shared.signals import set_by_signals
from shared.threads import described, faults_go_to, supervised

# Services of which a room has place for one: a second robot service would stop the first one's moves.
ONE_IN_A_ROOM: frozenset[ServiceName] = frozenset({"robot"})
# The robot stops a motion when a service that was there falls silent; nobody stops the robot service for its silence.
HEARTBEAT_HZ: dict[ServiceName, float] = {"imaging": 20.0, "registration": 20.0, "robot": 5.0, "ui_api": 20.0}
# A handler of the robot that fails may be the one that would have stopped a motion.
FAULT_AT_ANY_ERROR: frozenset[ServiceName] = frozenset({"robot"})
# As long as somebody needs to see it on a health page.
ERROR_IMPAIRS_S: Final = 60.0
_LEAVE_WITHIN_S = 10.0

S = TypeVar("S", bound=ServiceSettings)
BusOpener = Callable[[BusSettings], AbstractContextManager[Bus]]
# How a process shows the room that its service is there, for as long as the context lasts.
Showing = Callable[[Bus, "Runtime", ServiceSettings], AbstractContextManager[None]]


@dataclass(slots=True)
class Runtime:
    """What a service's composition gets beside the bus.

    Attributes
    ----------
    boot_epoch
        Names this run of the service: new with every start.
    stop
        Set when the service is to end; workers leave when they see it.
    fault
        Why the service ends with a fault, or None.
    first_on_fault
        Called with the fault's sentence before anything else is done about it: for a stop.
    errors
        Pieces of work that brought an exception, by place: handlers on the bus, threads of libraries.
    last_error_s
        When the last of them did that nobody foresaw, on the monotonic clock.
    """

    service: ServiceName
    boot_epoch: str
    keys: Keys
    log: Log
    status: StatusReporter
    stop: threading.Event = field(default_factory=threading.Event)
    fault: str | None = None
    first_on_fault: list[Callable[[str], None]] = field(default_factory=list)
    errors: Counter[str] = field(default_factory=Counter)
    last_error_s: float = float("-inf")

    def fail(self, message: str) -> None:
        """End the service with a fault: logged now, exit code 1. The first fault is kept. Never raises."""
        self.fault = self.fault or message
        self.stop.set()
        for act in self.first_on_fault:
            try:
                act(message)
            except Exception:
                self.log.exception("what had to be done about a fault failed", fault=message)
        self.log.error("fault", detail=message)

    def note_error(self, place: str, error: BaseException) -> None:
        """Count an exception that ended no loop of the service; it has been logged.

        A message or an image that was refused is only counted. What nobody foresaw impairs the service for a while, and
        is a fault of one whose errors may not pass: of the robot.
        """
        self.errors[place] += 1
        if isinstance(error, DistalockError):
            return
        if self.service in FAULT_AT_ANY_ERROR:
            self.fail(f"{place} brought {described(error)}")
            return
        self.last_error_s = time.monotonic()
        self.status.impair("errors", f"{place} brought {described(error)} ({self.errors[place]} so far); see the log")

    def forget_errors(self) -> None:
        """Take the impairment by errors back when the last one is some time ago."""
        if time.monotonic() - self.last_error_s > ERROR_IMPAIRS_S:
            self.status.impair("errors", None)

    def ready(self, detail: str = "") -> None:
        """Report that the service does its work."""
        self.status.report("ready", detail)

    def degraded(self, detail: str) -> None:
        """Report what the service cannot do at the moment, and what to do about it."""
        self.status.report("degraded", detail)


def software_version() -> str:
    """Version of the installed package; ``0+unknown`` when run from a folder that was not installed."""
    try:
        return version("distalock")
    except PackageNotFoundError:
        return "0+unknown"


@contextmanager
def whole_service(bus: Bus, runtime: Runtime, settings: ServiceSettings) -> Iterator[None]:
    """What a service shows that is one process: that it is there, that it lives, and how it fares."""
    note_beat = _noted_in(settings.health_file, runtime)
    with _place_in_room(bus, runtime), reporting(runtime, settings), living(bus, runtime, note_beat=note_beat):
        yield


@contextmanager
def reporting(runtime: Runtime, settings: ServiceSettings) -> Iterator[None]:
    """The service's condition: ``starting`` on entry, ``stopping`` on leaving, and what impairs it meanwhile."""
    runtime.status.report("starting")
    check_bus(settings.router_endpoint, runtime.keys, MemoryLimits.of_this_process(), runtime.log, runtime.status)
    with watched(runtime, settings):
        runtime.log.info(
            "started", version=software_version(), router=settings.router_endpoint, real_time=has_precedence()
        )
        try:
            yield
        finally:
            runtime.status.report("stopping")


def living(
    bus: Bus,
    runtime: Runtime,
    is_alive: Callable[[], bool] = always,
    note_beat: Callable[[], None] = nothing,
) -> AbstractContextManager[None]:
    """Liveliness token and heartbeats."""
    service = runtime.service
    return beating(bus, runtime.keys, service, runtime.boot_epoch, HEARTBEAT_HZ[service], is_alive, note_beat)


def _noted_in(file: Path | None, runtime: Runtime) -> Callable[[], None]:
    """Notes heartbeats with the service's condition in a file, if there is one."""
    if file is None:
        return nothing
    health = HealthFile(file)
    return lambda: health.note(runtime.status.condition or "starting")


@contextmanager
def open_service(
    name: ServiceName,
    settings: ServiceSettings,
    opener: BusOpener = open_bus,
    showing: Showing = whole_service,
    boot_epoch: str | None = None,
) -> Iterator[tuple[Bus, Runtime]]:
    """Logging, bus, liveliness token, heartbeats and status of a service, for as long as the context lasts.

    Reports ``starting`` on entry and ``stopping`` on leaving; the service calls `Runtime.ready` when it is.

    Parameters
    ----------
    showing, boot_epoch
        Of a service that is several processes: what this one shows of it, and the run that they have in common.

    Raises
    ------
    BusUnavailable
        When no router answers in time.
    ServiceAlreadyRuns
        When the room has such a service already and place for one only; nothing was published.
    """
    boot_epoch = boot_epoch or secrets.token_hex(8)
    log = configure_logging(name, settings.room, boot_epoch, settings.log_level, settings.log_file)
    keys = Keys(settings.room)
    with opener(bus_settings(name, settings)) as bus:
        status = StatusReporter(bus.retained_publisher(keys.status(name)), name, boot_epoch, software_version())
        runtime = Runtime(name, boot_epoch, keys, log, status)
        with faults_go_to(runtime), showing(bus, runtime, settings):
            yield bus, runtime
    log.info("ended")
    flush_logs()


def _place_in_room(bus: Bus, runtime: Runtime) -> AbstractContextManager[None]:
    if runtime.service not in ONE_IN_A_ROOM:
        return nullcontext()
    return sole_service(bus, runtime.keys, runtime.service, runtime.boot_epoch, runtime.fail)


def service_main(
    name: ServiceName,
    kind: type[S],
    compose: Callable[[S, Bus, Runtime], AbstractContextManager[object]],
    arguments: Sequence[str] | None = None,
) -> int:
    """What a service's `__main__` returns to the shell: read arguments (there are none) and settings, `run_service`.

    Raises
    ------
    SystemExit
        For `--help` (code 0) and unknown arguments (code 2), before anything is started.
    """
    service_parser(name, kind).parse_args(arguments)
    share_arenas()
    try:
        settings = load_settings(kind)
    except ConfigurationError as error:
        return _refuse_start(name, error)
    return run_service(name, settings, lambda bus, runtime: compose(settings, bus, runtime))


def run_service(
    name: ServiceName,
    settings: ServiceSettings,
    compose: Callable[[Bus, Runtime], AbstractContextManager[object]],
    opener: BusOpener = open_bus,
    showing: Showing = whole_service,
    boot_epoch: str | None = None,
) -> int:
    """Run a service until SIGTERM, SIGINT or a fault. Call from the main thread.

    Parameters
    ----------
    compose
        Builds the service and runs it for as long as its context lasts. When it has not reported a condition itself by
        the time it is entered, ``ready`` is reported.
    showing, boot_epoch
        See `open_service`.

    Returns
    -------
    int
        Exit code: 0 after a clean end, 1 after a fault, 2 when it cannot start (one line on stderr says why).
    """
    try:
        with (
            _end_when_leaving_hangs(name) as leaving,
            open_service(name, settings, opener, showing, boot_epoch) as (bus, runtime),
            set_by_signals(runtime.stop),
            compose(bus, runtime),
        ):
            if runtime.status.condition == "starting":
                runtime.ready()
            runtime.stop.wait()
            leaving.start()
    except (ConfigurationError, BusUnavailable) as error:
        return _refuse_start(name, error)
    except Exception as error:  # noqa: BLE001 - the border of the process: the fault is logged and becomes the exit code
        structlog.stdlib.get_logger(f"distalock.{name}").exception("fault")
        return _end_with_fault(name, described(error))
    return _end_with_fault(name, runtime.fault) if runtime.fault else 0


def _end_with_fault(name: ServiceName, fault: str) -> int:
    flush_logs()
    _tell_terminal(f"{name}: fault: {fault}")
    return 1


def _refuse_start(name: ServiceName, error: DistalockError) -> int:
    _tell_terminal(f"{name}: {error}")
    return 2


def _tell_terminal(sentence: str) -> None:
    with suppress(OSError, ValueError):  # nobody is there any more
        print(sentence, file=sys.stderr, flush=True)  # noqa: T201 - the one sentence for the person at the terminal


@contextmanager
def _end_when_leaving_hangs(name: ServiceName) -> Iterator[threading.Timer]:
    """A timer that ends the process by force, to be started when leaving begins: half left is worse than killed."""

    def end() -> None:
        log = structlog.stdlib.get_logger(f"distalock.{name}")
        log.error("fault", detail=f"leaving took longer than {_LEAVE_WITHIN_S:g} s; ended by force")
        flush_logs()
        os._exit(1)

    timer = threading.Timer(_LEAVE_WITHIN_S, supervised("leaving", end))
    timer.daemon = True
    try:
        yield timer
    finally:
        timer.cancel()

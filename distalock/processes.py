"""Start, watch and stop a set of local processes in order.

Services are real processes even on one machine: what `distalock up` runs is what containers run.
"""

import fcntl
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import IO, Self

from distalock.lifelines import Lifelines
from distalock.reservations import reserved
from shared.errors import ConfigurationError
from shared.signals import PARENT_PIPE

_STOP_PATIENCE_S = 8.0
_POLL_S = 0.05
_LEAST_FREE_BYTES = 64 * 2**20
MOST_OUTPUT_BYTES = 2**20
LOG_FILE = "DISTALOCK_LOG_FILE"


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """One process to run.

    Attributes
    ----------
    name
        For people, log files and error messages.
    module
        Python module to run with ``python -m``.
    arguments, environment
        Beyond what this process's own environment holds.
    is_ready
        Asked until true, before the next process starts.
    """

    name: str
    module: str
    is_ready: Callable[[], bool]
    arguments: tuple[str, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)


class Fleet:
    """The running processes. Started in the order given, stopped in the reverse order.

    `prepare` is called before the first of them, when the folder belongs to this fleet alone.
    """

    def __init__(
        self,
        specs: Sequence[ProcessSpec],
        log_dir: Path,
        start_patience_s: float = 60.0,
        stop: threading.Event | None = None,
        reservations: Mapping[str, str] = MappingProxyType({}),
        prepare: Callable[[], object] = lambda: None,
    ) -> None:
        self._specs = tuple(specs)
        self._log_dir = log_dir
        self._start_patience_s = start_patience_s
        self._stop = stop or threading.Event()
        self._prepare = prepare
        self._running: list[tuple[ProcessSpec, subprocess.Popen[bytes]]] = []
        self._reservations = reservations
        self._held = ExitStack()
        self._lifelines = Lifelines()

    def __enter__(self) -> Self:
        with ExitStack() as held:
            held.enter_context(reserved(self._reservations))
            held.enter_context(taken_folder(self._log_dir))
            held.enter_context(self._lifelines)
            self._held = held.pop_all()
        try:
            self._prepare()
            for spec in self._specs:
                self._start(spec)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name."""
        return {spec.name: process.pid for spec, process in self._running}

    def wait_until_one_ends(self) -> str | None:
        """Block until the stop event is set (then None) or a process ends by itself (then its name)."""
        while not self._stop.wait(_POLL_S):
            if (ended := self._first_ended()) is not None:
                return ended.name
            self._cut_output()
        return None

    @property
    def ended(self) -> tuple[str, ...]:
        """Names of the processes that have ended."""
        return tuple(spec.name for spec, process in self._running if process.poll() is not None)

    def last_words(self, name: str) -> str:
        """Last line that a process wrote, for error messages: of what it printed, else of its log."""
        for file in (self._output_file(name), self._log_file(name)):
            try:
                lines = file.read_text(errors="replace").strip().splitlines()
            except OSError:
                continue
            if lines:
                return lines[-1]
        return "it wrote nothing"

    def restart(self, name: str, change: Callable[[ProcessSpec], ProcessSpec] = lambda spec: spec) -> None:
        """Start a process again, after ending it if it still runs; `change` may replace what is run.

        Raises
        ------
        ConfigurationError
            When it does not start.
        """
        spec, process = self.end(name)
        self._running.remove((spec, process))
        self._start(change(spec))

    def forget(self, name: str) -> None:
        """Miss a process no longer that has ended."""
        self._running = [entry for entry in self._running if entry[0].name != name]

    def end(self, name: str) -> tuple[ProcessSpec, subprocess.Popen[bytes]]:
        """End a process that still runs, and wait for that."""
        spec, process = next(entry for entry in self._running if entry[0].name == name)
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            _wait_or_kill(process)
        return spec, process

    def stop(self) -> None:
        """End every process, the last started first; those that do not leave in time are killed."""
        for _, process in reversed(self._running):
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                _wait_or_kill(process)
        self._running.clear()
        self._held.close()

    def _output_file(self, name: str) -> Path:
        """What a process printed: why it did not start, or how it broke down."""
        return self._log_dir / f"{name}.log"

    def _log_file(self, name: str) -> Path:
        """What a service logs, by itself, in files that rotate."""
        return self._log_dir / f"{name}.jsonl"

    def _first_ended(self) -> ProcessSpec | None:
        return next((spec for spec, process in self._running if process.poll() is not None), None)

    def _cut_output(self) -> None:
        """Empty what grew too long; the processes append, and go on at the new end."""
        for spec, _ in self._running:
            file = self._output_file(spec.name)
            with suppress(OSError):
                if file.stat().st_size > MOST_OUTPUT_BYTES:
                    os.truncate(file, 0)

    def _start(self, spec: ProcessSpec) -> None:
        with self._output_file(spec.name).open("ab") as log, self._lifelines.handed_over(spec.name) as lifeline:
            environment = {LOG_FILE: str(self._log_file(spec.name)), PARENT_PIPE: str(lifeline)}
            # A session of its own: Ctrl-C reaches only us, and we stop the others in order.
            process = subprocess.Popen(
                [sys.executable, "-m", spec.module, *spec.arguments],
                env={**os.environ, **environment, **spec.environment},
                pass_fds=(lifeline,),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._running.append((spec, process))
        deadline = time.monotonic() + self._start_patience_s
        while not spec.is_ready():
            if self._stop.is_set():
                raise ConfigurationError(f"interrupted while {spec.name} was starting; everything was stopped again")
            if (ended := self._first_ended()) is not None:
                raise ConfigurationError(f"{ended.name} did not start: {self.last_words(ended.name)}")
            if time.monotonic() > deadline:
                waited = f"{spec.name} was not ready after {self._start_patience_s:.0f} s"
                raise ConfigurationError(f"{waited}; see {self._output_file(spec.name)}")
            time.sleep(_POLL_S)


def _wait_or_kill(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(_STOP_PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def taken_folder(log_dir: Path) -> IO[bytes]:
    """Make the folder and hold it, until the file is closed, against a second fleet that would write the same files.

    Raises
    ------
    ConfigurationError
        When it cannot be written, is nearly full, or another fleet holds it.
    """
    try:
        log_dir.mkdir(parents=True, exist_ok=True)
        lock = (log_dir / "lock").open("ab")
        free_bytes = shutil.disk_usage(log_dir).free
    except OSError as error:
        raise ConfigurationError(
            f"the state folder {log_dir.parent} cannot be written ({error.strerror}); choose another with --state"
        ) from None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.close()
        raise ConfigurationError(
            f"the state folder {log_dir.parent} is in use by another installation that runs now; end it, or choose "
            "another with --state"
        ) from None
    if free_bytes < _LEAST_FREE_BYTES:
        lock.close()
        raise ConfigurationError(
            f"the state folder {log_dir.parent} has {free_bytes / 2**20:.1f} MiB free, at least "
            f"{_LEAST_FREE_BYTES / 2**20:.0f} MiB are needed; free some, or choose another with --state"
        )
    return lock

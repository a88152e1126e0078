"""What else a gateway has to do while a stop is timed."""

import json
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import httpx

from benchmarks.robot.stop_latency_rig import StopRig
from distalock.rest_client import bearer
from services.ui_api.record.location import sqlite_url
from shared.scheduling import ordinary

VIEWERS: Final = 20
EVENT_CLIENTS: Final = 50
IDLE_CONNECTIONS: Final = 2000
HUNG_REQUESTS: Final = 30
OTHER_STOPS: Final = 20
_ENDS_WITHIN_S: Final = 20.0
# Of clients and C-arm, which are other machines: they take what the installation leaves.
_NICE: Final = 19
_NEXT_FRAME: Final = {"number": 1}


@dataclass(frozen=True, slots=True)
class ClientsOfAll:
    """How many of each kind.

    Attributes
    ----------
    of_case
        Whether the frames are of the open case: then each is recorded, and a plan from the one before is stale.
    """

    viewers: int = VIEWERS
    events: int = EVENT_CLIENTS
    idle: int = IDLE_CONNECTIONS
    stuck: int = 0
    of_case: bool = True


def _let_others_go_first(session: int) -> None:
    """Clients and C-arm are other machines: here they take only what the installation leaves.

    Linux gives each session the same share of the processors, however nice its processes are, while it groups them
    automatically; then the session has a niceness of its own.
    """
    with suppress(OSError):
        Path(f"/proc/{session}/autogroup").write_text(str(_NICE))


class LoadProcess:
    """A module of this folder, which says `ready` and ends with its standard input; `result` is its last line."""

    def __init__(self, module: str, arguments: Mapping[str, object]) -> None:
        words = [word for name, value in arguments.items() for word in (f"--{name}", str(value))]
        command = ["nice", "-n", str(_NICE), sys.executable, "-m", f"benchmarks.robot.{module}", *words]
        with ordinary():
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
            )
        _let_others_go_first(self._process.pid)
        self.result = ""

    def wait_until_ready(self) -> None:
        """Wait for its word."""
        assert self._process.stdout is not None
        if self._process.stdout.readline().strip() != "ready":
            raise RuntimeError(f"{self._process.args!r} did not start")

    def end(self) -> None:
        """End it and keep what it says."""
        try:
            self.result = self._process.communicate(timeout=_ENDS_WITHIN_S)[0].strip().rpartition("\n")[2]
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()


@contextmanager
def clients(rig: StopRig, counts: ClientsOfAll = ClientsOfAll()) -> Iterator[dict[str, int]]:
    """Viewers, event streams and idle connections, and 30 frames/s; on leaving, what they received is filled in."""
    received: dict[str, int] = {}
    case, revision = rig.case
    installation = rig.installation
    frames = LoadProcess(
        "frame_source",
        {
            "router": installation.router_endpoint,
            "state": installation.state_dir,
            "first": _NEXT_FRAME["number"],
            **({"case": case, "revision": revision} if counts.of_case else {}),
        },
    )
    everybody = LoadProcess(
        "gateway_load",
        {
            "rest-port": installation.ports.rest,
            "token": installation.token,
            "viewers": counts.viewers,
            "events": counts.events,
            "idle": counts.idle,
            "stuck": counts.stuck,
        },
    )
    try:
        for process in (frames, everybody):
            process.wait_until_ready()
        yield received
    finally:
        everybody.end()
        frames.end()
        received.update(json.loads(everybody.result or "{}"))
        received["frames"] = int(frames.result or 0) - _NEXT_FRAME["number"]
        _NEXT_FRAME["number"] = int(frames.result or 1)


def stops_on_record(state_dir: Path) -> int:
    """How many stops the record has."""
    with closing(sqlite3.connect(_record_file(state_dir))) as connection:
        return int(connection.execute("SELECT count(*) FROM events WHERE kind = 'stop_requested'").fetchone()[0])


def _record_file(state_dir: Path) -> str:
    return sqlite_url(state_dir).removeprefix("sqlite:///")


@contextmanager
def blocked_record(state_dir: Path) -> Iterator[None]:
    """Another program holds the case record's write lock."""
    with closing(sqlite3.connect(_record_file(state_dir), timeout=60.0, isolation_level=None)) as connection:
        connection.execute("BEGIN IMMEDIATE")
        try:
            yield
        finally:
            connection.execute("ROLLBACK")


@contextmanager
def hung_requests(rest_url: str, token: str, count: int = HUNG_REQUESTS) -> Iterator[None]:
    """Requests that wait for the record, one after another from each of so many clients."""
    ended = threading.Event()

    def ask(number: int) -> None:
        with httpx.Client(base_url=rest_url, headers=bearer(token), timeout=None) as client:  # noqa: S113 - it is to hang
            attempt = 0
            while not ended.is_set():
                attempt += 1
                key = {"Idempotency-Key": f"hung-{number}-{attempt}"}
                try:
                    client.post("/api/v1/robot/reset", headers=key)
                except httpx.HTTPError:
                    return

    threads = [threading.Thread(target=ask, args=(number,), daemon=True) for number in range(count)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        for thread in threads:
            thread.join(_ENDS_WITHIN_S)


@contextmanager
def other_stops(rest_url: str, sent: list[int], count: int = OTHER_STOPS) -> Iterator[None]:
    """So many other stops, sent at once and waiting for the record meanwhile."""
    gone_out = threading.Barrier(count + 1)

    def stop() -> None:
        gone_out.wait()
        httpx.post(f"{rest_url}/api/v1/robot/stop", timeout=_ENDS_WITHIN_S)

    with ExitStack() as stack:
        threads = [threading.Thread(target=stop, daemon=True) for _ in range(count)]
        for thread in threads:
            thread.start()
            stack.callback(thread.join, _ENDS_WITHIN_S)
        gone_out.wait()
        sent.append(count)
        yield

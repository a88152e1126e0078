"""`make containers`: from a clone to a drilled femur, in containers, with the robot's container killed in motion.

usage: python -m tools.containers [--keep]
"""

import argparse
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from distalock.demo import conclusion
from distalock.procedure import Ending, Outcome
from distalock.readiness import Server
from distalock.rest_client import RestClient
from distalock.running_procedure import procedure_at, wait_until_usable
from shared.errors import DistalockError
from tools.containers.composition import IMAGES, SERVICES, Composition

PROJECT: Final = "distalock-check"
_READY_WITHIN_S: Final = 300.0
_LOOK_EVERY_S: Final = 0.01
# A motion is over by then, whatever becomes of it.
_AT_REST_WITHIN_S: Final = 15.0
SAFE_WITHIN_S: Final = 0.5
_BYTES_PER_MB: Final = 1e6


def main(arguments: Sequence[str] | None = None) -> int:
    """0 when both holes were drilled, and the robot was safe after its container had been killed in motion."""
    parser = argparse.ArgumentParser(prog="make containers", description=__doc__)
    parser.add_argument("--keep", action="store_true", help="leave the installation running")
    given = parser.parse_args(arguments)
    try:
        composition = Composition(PROJECT)
        print(f"building on {composition.base}", flush=True)
        composition.build()
        for image in IMAGES:
            print(f"{image}: {composition.layers_bytes(image) / _BYTES_PER_MB:.0f} MB above the base", flush=True)
        try:
            composition.up()
            return _tried(composition)
        finally:
            if given.keep:
                print(f"left running: REST at https://127.0.0.1:{composition.ports[0]}, room at {composition.room_url}")
            else:
                composition.down()
    except (DistalockError, TimeoutError) as error:
        print(f"make containers: {error}", file=sys.stderr)
        return 2


def _tried(composition: Composition) -> int:
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        server = composition.server(Path(folder))
        wait_until_usable(server, _READY_WITHIN_S)
        _say(f"ready {time.monotonic() - began_s:.1f} s after the containers were started")
        safe_s = _robot_killed_in_motion(composition, server)
        if safe_s is None or safe_s > SAFE_WITHIN_S:
            _say(f"the robot was not at rest and locked within {SAFE_WITHIN_S} s: {safe_s}")
            return 1
        _say(f"robot's container killed in motion: at rest and locked after {safe_s:.2f} s")
        wait_until_usable(server, _READY_WITHIN_S)
        outcome = procedure_at(server, composition.token(), composition.room_url, _say)
    _say(conclusion(outcome))
    unwell = [service for service in SERVICES if composition.health(service) not in ("healthy", "starting")]
    if unwell:
        _say(f"not healthy: {', '.join(unwell)}")
    return 0 if outcome.ending is Ending.DRILLED and not unwell else 1


def _robot_killed_in_motion(composition: Composition, server: Server) -> float | None:
    """From the kill to at rest and locked, by the controller's clock; the procedure under way is refused."""
    found: list[float | None] = []
    with RestClient(composition.room_url) as room:
        watch = threading.Thread(target=lambda: found.append(_kill_when_it_moves(composition, room)), daemon=True)
        watch.start()
        outcome: Outcome = procedure_at(server, composition.token(), composition.room_url, _say)
        watch.join(_AT_REST_WITHIN_S)
    _say(f"the procedure ended as it must: {outcome.ending}: {outcome.why}")
    return found[0] if found else None


def _kill_when_it_moves(composition: Composition, room: RestClient) -> float | None:
    pid = composition.pid("robot")
    deadline_s = time.monotonic() + _READY_WITHIN_S
    while not room.get("/controller")["moving"]:
        if time.monotonic() > deadline_s:
            return None
        time.sleep(_LOOK_EVERY_S)
    before_s = _number(room.get("/controller")["clock_s"])
    os.kill(pid, signal.SIGKILL)  # not `docker kill`, after which docker would not start it again
    return _safe_after_s(room, before_s)


def _safe_after_s(room: RestClient, before_s: float) -> float | None:
    """From a moment on the controller's clock until it was at rest and locked."""
    deadline_s = time.monotonic() + _AT_REST_WITHIN_S
    while time.monotonic() < deadline_s:
        seen = room.get("/controller")
        rest_s, locked_s = seen["at_rest_since_s"], seen["locked_since_s"]
        if rest_s is not None and locked_s is not None:
            return max(_number(rest_s), _number(locked_s)) - before_s
        time.sleep(_LOOK_EVERY_S)
    return None


def _number(value: object) -> float:
    if not isinstance(value, int | float):
        raise TypeError(f"expected a number, got {value!r}")
    return float(value)


def _say(line: str) -> None:
    print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())

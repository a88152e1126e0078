"""The services of one room without their work: `python -m benchmarks.rooms.light_room ROOM ENDPOINT STATE`.

Each has its own session with its own certificate, shows itself, and sends what the service sends: heartbeats, status,
the robot's state. Commands go from the gateway's session to the robot's, as they do. It says "ready", then reads a line
at a time: ``measure SECONDS`` prints latencies in seconds, ``flood on`` and ``flood off`` let this room say everything
that it can, as fast as it can.
"""

import json
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from shared.bus.access import SERVICES
from shared.bus.keys import Keys
from shared.bus.port import Answer, Sample
from shared.bus.settings import BusSettings
from shared.bus.tls import TlsFiles
from shared.bus.zenoh_bus import ZenohBus, open_bus
from shared.errors import BusUnavailable, NoReply
from shared.messages.base import decode, encode
from shared.messages.presence import Heartbeat, ServiceName, ServiceStatus
from shared.messages.robot import RobotState
from shared.robot_states import MotionState, StopLatch
from shared.threads import supervised_thread

STATE_HZ: Final = 20.0
BEAT_HZ: Final = 10.0
FRAME_BYTES: Final = 2_000_000
TIMEOUT_S: Final = 5.0
_PAUSE_S: Final = 0.01
_S_TO_NS: Final = 1e9


class LightRoom:
    """Four sessions, and what goes between them."""

    def __init__(self, room: str, endpoint: str, state: Path, sessions: ExitStack) -> None:
        self.keys, self.flooding = Keys(room), threading.Event()
        self._bus: dict[ServiceName, ZenohBus] = {
            name: sessions.enter_context(open_bus(BusSettings(endpoint, 60.0, TlsFiles.in_state(state, name))))
            for name in SERVICES
        }
        self._lock, self._states_s, self._sequence = threading.Lock(), list[float](), 0
        self._state = self._bus["robot"].retained_publisher(self.keys.robot_state)
        self._frames = self._bus["imaging"].publisher(self.keys.frame)
        self._bus["robot"].queryable(self.keys.robot_command("stop"), lambda query: Answer(query.payload))
        self._bus["robot"].queryable(self.keys.robot_command("reset"), lambda query: Answer(query.payload))
        self._bus["ui_api"].subscribe_retained(self.keys.robot_state, self._on_state)
        self._bus["ui_api"].subscribe(self.keys.frame, lambda _: None)
        for name in SERVICES:
            self._show(name)

    def _show(self, name: ServiceName) -> None:
        bus = self._bus[name]
        bus.declare_alive(self.keys.alive(name))
        status = ServiceStatus(service=name, boot_epoch="light", version="0.1.0", condition="ready", sent_at_ns=1)
        bus.retained_publisher(self.keys.status(name)).put(encode(status))
        beats, beat = bus.publisher(self.keys.heartbeat(name)), Heartbeat(service=name, boot_epoch="light", sequence=0)
        supervised_thread("beats", lambda: _repeated(BEAT_HZ, lambda: beats.put(encode(beat)))).start()

    def send_states(self) -> None:
        """States at their rate; as fast as they go, with frames, while this room floods."""
        while True:
            self._put_state()
            if self.flooding.is_set():
                self._frames.put(bytes(FRAME_BYTES), b"{}")
            else:
                time.sleep(1.0 / STATE_HZ)

    def _put_state(self) -> None:
        self._sequence += 1
        self._state.put(encode(_state(self._sequence)))

    def _on_state(self, sample: Sample) -> None:
        state = decode(RobotState, sample.payload)
        with self._lock:
            self._states_s.append((time.monotonic_ns() - state.sent_at_ns) / _S_TO_NS)

    def measure(self, seconds: float) -> dict[str, list[float]]:
        """Latencies of stops, commands and states for a while."""
        with self._lock:
            self._states_s.clear()
        stops, commands, lost, until_s = list[float](), list[float](), list[float](), time.monotonic() + seconds
        while time.monotonic() < until_s:
            for verb, answered in (("stop", stops), ("reset", commands)):
                took_s = self._asked_s(verb)
                (lost if took_s is None else answered).append(took_s or 0.0)
            time.sleep(_PAUSE_S)
        with self._lock:
            return {"stop": stops, "command": commands, "state": list(self._states_s), "lost": lost}

    def _asked_s(self, verb: str) -> float | None:
        """From asking to the answer; None when none came, as when a link was lost on a machine that has no time."""
        began_s = time.perf_counter()
        key = self.keys.robot_command("stop" if verb == "stop" else "reset")
        try:
            self._bus["ui_api"].query(key, bytes(500), TIMEOUT_S)
        except (NoReply, BusUnavailable):
            return None
        return time.perf_counter() - began_s


def _state(sequence: int) -> RobotState:
    """Its detail changes once a second, so that a summary goes to the site; its time is the monotonic clock's."""
    now_ns = time.monotonic_ns()
    return RobotState(
        boot_epoch="light",
        sequence=sequence,
        sent_at_ns=now_ns,
        state=MotionState.LOCKED,
        stop=StopLatch.CLEAR,
        locked=True,
        referenced=True,
        pose=None,
        leg_lengths_mm=None,
        pivot_mm=(0.0, 0.0, 0.0),
        hexapod_sha256="0" * 64,
        detail=str(now_ns // 1_000_000_000 * 1_000_000_000),
    )


def _repeated(rate_hz: float, work: Callable[[], None]) -> None:
    while True:
        work()
        time.sleep(1.0 / rate_hz)


def run() -> int:
    """Run until standard input ends."""
    room, endpoint, state = sys.argv[1], sys.argv[2], Path(sys.argv[3])
    with ExitStack() as sessions:
        light = LightRoom(room, endpoint, state, sessions)
        supervised_thread("states", light.send_states).start()
        print("ready", flush=True)
        for line in sys.stdin:
            match line.split():
                case ["measure", seconds]:
                    print(json.dumps(light.measure(float(seconds))), flush=True)
                case ["flood", "on"]:
                    light.flooding.set()
                    print("on", flush=True)
                case _:
                    light.flooding.clear()
                    print("off", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(run())

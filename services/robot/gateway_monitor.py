"""Watches over the gateway (heartbeat and token), the link and the others: in motion, losing one of them stops it."""

import threading
from collections.abc import Callable

from services.robot.core.status import UNDER_WAY
from services.robot.core.tuning import RATES
from services.robot.drive.drive import Drive
from services.robot.other_services import OtherServices
from shared.bus.keys import Keys
from shared.bus.port import Bus, Presence, Sample
from shared.errors import InputError
from shared.messages.base import decode
from shared.messages.presence import Heartbeat
from shared.runtime.watchdog import Watchdog
from shared.threads import supervised_thread


class GatewayMonitor:
    """Listens to the gateway from construction on, and stops the robot, when anything is lost, from `start` on.

    Parameters
    ----------
    deadline_s
        Longest silence of the gateway while the robot moves.
    clock_s
        Monotonic clock.
    others
        Who else is watched while the robot moves.
    """

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        drive: Drive,
        deadline_s: float,
        clock_s: Callable[[], float],
        others: OtherServices,
    ) -> None:
        self._others = others
        self._presence: Presence = bus.presence()
        self._drive = drive
        self._deadline_s = deadline_s
        self._clock_s = clock_s
        self._watchdog = Watchdog(deadline_s, clock_s)
        self._boot_epoch: str | None = None
        self._sequence = -1
        self._ended = threading.Event()
        self._thread = supervised_thread("gateway-watch", self._watch)
        self._declared = (
            bus.subscribe(keys.heartbeat("ui_api"), self._on_heartbeat),
            self._presence.watch_alive(keys.alive("ui_api"), self._on_alive),
        )

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def close(self) -> None:
        """Leave; the robot must be stopped before."""
        self._ended.set()
        self._thread.join()
        for declared in self._declared:
            declared.close()

    def link_up(self) -> bool:
        """Whether the router is there."""
        return self._presence.link_up()

    def heartbeat_s(self) -> float | None:
        """When the gateway was last heard, on the monotonic clock; None when never."""
        silent_s = self._watchdog.silent_for_s()
        return None if silent_s == float("inf") else self._clock_s() - silent_s

    def _on_heartbeat(self, sample: Sample) -> None:
        try:
            heartbeat = decode(Heartbeat, sample.payload)
        except InputError:
            return  # Not a sign of life: the deadline runs on.
        if heartbeat.boot_epoch == self._boot_epoch and heartbeat.sequence <= self._sequence:
            return  # A repeat is no sign of life.
        restarted = self._boot_epoch not in (None, heartbeat.boot_epoch)
        self._boot_epoch, self._sequence = heartbeat.boot_epoch, heartbeat.sequence
        self._watchdog.feed()
        if restarted:
            self._drive.supervision_lost("the gateway was restarted during a motion; check the room and acknowledge")

    def _on_alive(self, key: str, alive: bool) -> None:  # noqa: FBT001 - the signature is the bus's
        del key
        if not alive:
            self._drive.supervision_lost("the gateway has gone (its token vanished); restart it and acknowledge")

    def _watch(self) -> None:
        while not self._ended.wait(RATES.gateway_check_s):
            self.check()

    def check(self) -> None:
        """Check once: what the thread does over and over, for it or for a test in its place."""
        self._others.check()
        if self._drive.status.state not in UNDER_WAY:
            return
        if not self._presence.link_up():
            self._drive.supervision_lost("the link to the router was lost; see to the network and acknowledge")
        elif self._watchdog.expired():
            self._drive.supervision_lost(
                f"the gateway was silent for {self._watchdog.silent_for_s():.2f} s (limit {self._deadline_s:g} s); "
                "see that it runs and acknowledge"
            )

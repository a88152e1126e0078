"""Watches the services that a motion does not need but that were there when it began: losing one stops it.

Whatever dies, motion ends. What has never been heard, or was lost before the motion began, is not missed: the guard
decides what a motion needs.
"""

from collections.abc import Callable

from services.robot.core.status import UNDER_WAY
from services.robot.core.tuning import RATES
from services.robot.drive.drive import Drive
from shared.bus.keys import Keys
from shared.bus.port import Bus, Sample
from shared.messages.presence import ServiceName
from shared.runtime.watchdog import Watchdog

OTHERS: tuple[ServiceName, ...] = ("imaging", "registration")


class OtherServices:
    """Listens from construction on; `check` is called over and over by whoever watches the gateway.

    Parameters
    ----------
    silent_for_s
        Further ones that give signs of life in another way, by name: how long each has been silent.
    """

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        drive: Drive,
        clock_s: Callable[[], float],
        silent_for_s: dict[str, Callable[[], float]],
    ) -> None:
        self._drive = drive
        self._silent_for_s = dict(silent_for_s)
        self._present: frozenset[str] | None = None
        self._presence = bus.presence()
        for service in OTHERS:
            watchdog = Watchdog(RATES.other_service_deadline_s, clock_s)
            self._silent_for_s[service] = watchdog.silent_for_s
            bus.subscribe(keys.heartbeat(service), _feeding(watchdog))
            self._presence.watch_alive(keys.alive(service), self._losing(service))

    def check(self) -> None:
        """Check once."""
        if self._drive.status.state not in UNDER_WAY:
            self._present = None
            return
        silent = {name for name, silent_for_s in self._silent_for_s.items() if self._is_silent(silent_for_s())}
        if self._present is None:
            self._present = frozenset(self._silent_for_s) - silent
        for name in sorted(self._present & silent):
            self._drive.supervision_lost(
                f"{name} was silent for more than {RATES.other_service_deadline_s:g} s; see to it and acknowledge"
            )

    def _is_silent(self, silent_s: float) -> bool:
        return silent_s > RATES.other_service_deadline_s

    def _losing(self, service: ServiceName) -> Callable[[str, bool], None]:
        def on_alive(key: str, alive: bool) -> None:  # noqa: FBT001 - the signature is the bus's
            del key
            # With the link all tokens vanish: then the link is what was lost, and the gateway's monitor says so.
            if not alive and self._presence.link_up():
                self._drive.supervision_lost(f"{service} has gone (its token vanished); restart it and acknowledge")

        return on_alive


def _feeding(watchdog: Watchdog) -> Callable[[Sample], None]:
    def on_heartbeat(sample: Sample) -> None:
        # Only that it was sent counts: whoever may send it is the access table's business, and nothing rests on it.
        del sample
        watchdog.feed()

    return on_heartbeat

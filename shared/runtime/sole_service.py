"""At most one service of a name in a room: a second one gives up before it publishes or touches anything.

Every candidate has an identity: when it started (by its own clock), then its boot epoch. It shows it with a liveliness
token `alive/{service}/{identity}`, and takes two steps, because two candidates may start at once:

1. Before it shows itself it observes the tokens of others. If one stays, the candidate gives up. A killed process loses
   its token at once, a host that vanished after the lease of 1 s, so a restarted service waits that long.
2. It declares its own token and observes again. Two that started at once have both passed step 1, and see each other
   now: the smaller identity stays, which is the one that started first; the other gives up.

Step 2 decides as long as a token reaches the other within `OBSERVE_S`. Where it did not (the link was down meanwhile),
both go on observing, and the larger identity ends with a fault as soon as it sees the smaller one.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.errors import ServiceAlreadyRuns
from shared.messages.presence import ServiceName

# Far above the 20 ms in which tokens were seen to travel, and short beside the second that a service takes to start.
OBSERVE_S: Final = 0.25
# The lease of 1 s after which the bus gives a silent host up, checked four times a lease, and as much again.
GONE_WITHIN_S: Final = 2.5


class _Others:
    """Tokens of other services of the same name."""

    def __init__(self, own_key: str, on_change: Callable[[frozenset[str]], None]) -> None:
        self._own_key = own_key
        self._on_change = on_change
        self._changed = threading.Condition()
        self._keys: frozenset[str] = frozenset()

    def observe(self, key: str, alive: bool) -> None:  # noqa: FBT001 - the signature is the bus's
        if key == self._own_key:
            return
        with self._changed:
            self._keys = self._keys | {key} if alive else self._keys - {key}
            self._changed.notify_all()
        self._on_change(self._keys)

    def older(self) -> frozenset[str]:
        """Those that go before this one."""
        return frozenset(key for key in self._keys if key < self._own_key)

    def gone_within(self, timeout_s: float) -> bool:
        """Wait until there are none."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._keys, timeout_s)


@contextmanager
def sole_service(
    bus: Bus, keys: Keys, service: ServiceName, boot_epoch: str, on_second: Callable[[str], None]
) -> Iterator[None]:
    """Be the only service of this name in the room for as long as the context lasts.

    Parameters
    ----------
    on_second
        Called with a sentence when another turns out, later, to have been there before.

    Raises
    ------
    ServiceAlreadyRuns
        When there is another: nothing was published.
    """
    own_key = keys.alive_as(service, f"{time.time_ns():020d}-{boot_epoch}")
    sentence = (
        f"another {service} service runs in room '{keys.room}'; end it before you start this one, or give this one a "
        "room of its own (DISTALOCK_ROOM)"
    )
    entered = threading.Event()

    def on_change(_others: frozenset[str]) -> None:
        if entered.is_set() and others.older():
            on_second(sentence)

    others = _Others(own_key, on_change)
    watch = bus.presence().watch_alive(keys.alive_as(service, "*"), others.observe)
    never = threading.Event()
    never.wait(OBSERVE_S)
    if not others.gone_within(GONE_WITHIN_S):
        watch.close()
        raise ServiceAlreadyRuns(sentence)
    token = bus.presence().declare_alive(own_key)
    never.wait(OBSERVE_S)
    try:
        if others.older():
            raise ServiceAlreadyRuns(sentence)
        entered.set()
        yield
    finally:
        token.close()
        watch.close()

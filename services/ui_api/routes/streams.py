"""Who follows what, on each event loop that serves: the one for streams, and under TLS the one for requests."""

import asyncio
from dataclasses import dataclass
from weakref import WeakKeyDictionary

from services.ui_api.routes.audience import Audience
from services.ui_api.routes.event_followers import EventFollower, event_programme
from services.ui_api.routes.live_viewers import Viewer, live_programme
from services.ui_api.service import Gateway


@dataclass(frozen=True, slots=True)
class Audiences:
    """Those of one event loop."""

    viewers: Audience[Viewer]
    followers: Audience[EventFollower]


class Streams:
    """The audiences of each loop, made when the first comes."""

    def __init__(self, gateway: Gateway) -> None:
        self._gateway = gateway
        self._of_loop: WeakKeyDictionary[asyncio.AbstractEventLoop, Audiences] = WeakKeyDictionary()

    def here(self) -> Audiences:
        """Those of the loop that runs."""
        loop = asyncio.get_running_loop()
        there = self._of_loop.get(loop)
        if there is None:
            gateway = self._gateway
            there = Audiences(
                Audience(live_programme(gateway), gateway.acting), Audience(event_programme(gateway), gateway.acting)
            )
            self._of_loop[loop] = there
        return there

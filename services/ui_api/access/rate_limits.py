"""Refuses requests of who sends too many, by token and by address: a program in a loop slows nobody else down."""

import hashlib
import threading
from collections import Counter

from services.ui_api.core.rate_limit import BURST_S, Buckets, RateSettings
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.refusals import RefusalKind, Refused


class RateLimits:
    """Counts requests; stops and leases are never asked about. Any thread may call."""

    def __init__(self, settings: RateSettings, clock: Clock) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._buckets = {"token": Buckets(settings.per_token_per_s), "address": Buckets(settings.per_address_per_s)}
        self.refused: Counter[str] = Counter({"token": 0, "address": 0})

    def require(self, token: str | None, address: str) -> None:
        """Count a request; raises `Refused` where there were too many.

        Parameters
        ----------
        token
            What the request shows, whether it is good or not; None where it shows none.
        """
        # What one token sends too much is not charged to the others of its address.
        keys = {} if token is None else {"token": hashlib.sha256(token.encode()).hexdigest()}
        keys["address"] = address
        for of, key in keys.items():
            with self._lock:
                wait_s = self._buckets[of].wait_s(key, self._clock.monotonic_s())
                self.refused[of] += wait_s > 0.0
            if wait_s > 0.0:
                raise self._refusal(of, address, wait_s)

    def _refusal(self, of: str, address: str, wait_s: float) -> Refused:
        per_s = self._buckets[of].per_s
        whose = "this token" if of == "token" else f"the address {address}"
        return Refused(
            RefusalKind.LOCKED,
            "rate_limited",
            f"{whose} has sent more than {per_s:g} requests a second, and {BURST_S * per_s:g} at once; wait "
            f"{wait_s:.2g} s, and follow the events in place of asking again and again",
            wait_s,
        )

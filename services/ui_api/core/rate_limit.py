"""How many requests somebody may send: token buckets, one for each key. Pure."""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

# Chosen: a hospital has fewer consoles; whoever is forgotten begins with a full bucket, which is a second too kind.
_MOST_KEYS: Final = 4096
# Chosen: a page that is loaded asks for some dozens of things at once, a test for hundreds.
BURST_S: Final = 10.0


@dataclass(frozen=True, slots=True)
class RateSettings:
    """Requests a second on the long run, of one token and of one address; 0 is no limit."""

    per_token_per_s: float
    per_address_per_s: float


NO_LIMITS: Final = RateSettings(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Bucket:
    """What is left of a bucket, and when it was so."""

    left: float
    at_s: float

    def refilled(self, per_s: float, now_s: float) -> "Bucket":
        """The bucket as it is now: it fills steadily, up to what comes in `BURST_S`."""
        return Bucket(min(self.left + (now_s - self.at_s) * per_s, BURST_S * per_s), now_s)


class Buckets:
    """A bucket for each key; those that were not used for longest are forgotten."""

    def __init__(self, per_s: float) -> None:
        self.per_s = per_s
        self._buckets: OrderedDict[str, Bucket] = OrderedDict()

    def wait_s(self, key: str, now_s: float) -> float:
        """0 when a request may be answered, which is counted; otherwise the time until one may."""
        if self.per_s <= 0.0:
            return 0.0
        full = Bucket(BURST_S * self.per_s, now_s)
        bucket = self._buckets.pop(key, full).refilled(self.per_s, now_s)
        granted = bucket.left >= 1.0
        self._buckets[key] = Bucket(bucket.left - 1.0, now_s) if granted else bucket
        while len(self._buckets) > _MOST_KEYS:
            self._buckets.popitem(last=False)
        return 0.0 if granted else (1.0 - bucket.left) / self.per_s

    def __len__(self) -> int:
        return len(self._buckets)

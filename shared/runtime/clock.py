"""The clocks that a service is given, so that tests can hand in their own."""

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Clock:
    """Wall clock for people and records, which is never compared, and monotonic clock for whatever is decided."""

    unix_ns: Callable[[], int] = time.time_ns
    monotonic_s: Callable[[], float] = time.monotonic

"""The clocks that handlers are given, so that tests can hand in their own."""

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Clock:
    """Wall clock for records (never compared across hosts) and monotonic clock for deadlines."""

    unix_ns: Callable[[], int] = time.time_ns
    monotonic_s: Callable[[], float] = time.monotonic

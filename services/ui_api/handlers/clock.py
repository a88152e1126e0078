"""The clocks that handlers are given, so that tests can hand in their own."""

from shared.runtime.clock import Clock as Clock

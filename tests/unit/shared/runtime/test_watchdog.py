"""The deadline on signs of life."""

import pytest

from shared.errors import ConfigurationError
from shared.runtime.watchdog import Watchdog


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def test_it_is_expired_until_the_first_sign_of_life_and_after_the_deadline() -> None:
    clock = Clock()
    watchdog = Watchdog(0.2, clock)
    assert watchdog.expired()
    assert watchdog.silent_for_s() == float("inf")
    watchdog.feed()
    clock.now_s += 0.19
    assert not watchdog.expired()
    clock.now_s += 0.02
    assert watchdog.expired()
    assert watchdog.silent_for_s() == pytest.approx(0.21)
    watchdog.feed()
    assert not watchdog.expired()
    watchdog.forget()
    assert watchdog.expired()


def test_deadline_must_be_positive() -> None:
    with pytest.raises(ConfigurationError, match=r"a watchdog's deadline must be positive, got 0 s"):
        Watchdog(0.0, Clock())

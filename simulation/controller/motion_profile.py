"""How a move proceeds in time: pieces of constant acceleration along a straight line, as a pure function of time."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Phase:
    """A piece of constant acceleration, in shares of the way per second squared."""

    duration_s: float
    acceleration_per_s2: float


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a move stands: share of the way (0 to 1) and shares per second."""

    share: float
    speed_per_s: float


@dataclass(frozen=True, slots=True)
class Profile:
    """Phases one after another, from an initial speed in shares of the way per second."""

    initial_speed_per_s: float
    phases: tuple[Phase, ...]

    @property
    def duration_s(self) -> float:
        """Time until rest."""
        return sum(phase.duration_s for phase in self.phases)

    def at(self, elapsed_s: float) -> Progress:
        """Progress after a time; at rest at the end once the duration has passed."""
        share, speed, left_s = 0.0, self.initial_speed_per_s, elapsed_s
        for phase in self.phases:
            t = min(left_s, phase.duration_s)
            share += speed * t + 0.5 * phase.acceleration_per_s2 * t * t
            speed += phase.acceleration_per_s2 * t
            left_s -= t
        return Progress(share, speed) if elapsed_s < self.duration_s else Progress(share, 0.0)


def rest_to_rest(cruise_per_s: float, ramp_s: float) -> Profile:
    """The whole way from rest to rest: ramp up, cruise, ramp down; a short way never reaches cruising speed.

    Parameters
    ----------
    cruise_per_s
        Cruising speed, in shares of the way per second.
    ramp_s
        Time to reach it.
    """
    acceleration = cruise_per_s / ramp_s
    peak = min(cruise_per_s, math.sqrt(acceleration))
    ramp = peak / acceleration
    cruise_s = 1.0 / peak - ramp
    return Profile(0.0, (Phase(ramp, acceleration), Phase(cruise_s, 0.0), Phase(ramp, -acceleration)))


def to_rest(speed_per_s: float, deceleration_per_s2: float) -> Profile:
    """From a speed to rest with constant deceleration."""
    return Profile(speed_per_s, (Phase(speed_per_s / deceleration_per_s2, -deceleration_per_s2),))

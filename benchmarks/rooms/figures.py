"""What is measured of rooms at one site."""

from dataclasses import dataclass

import numpy as np

from benchmarks.rooms.hospital import Latencies


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What goes on elsewhere, and rounds of the measured room without and with it.

    Attributes
    ----------
    control, disturbed
        Latencies by kind, round by round, in seconds. The control of a flood has the same flood at another site.
    """

    name: str
    control: list[Latencies]
    disturbed: list[Latencies]

    def ratio(self, kind: str) -> float:
        """Median over the rounds of the ratio of medians."""
        pairs = zip(self.disturbed, self.control, strict=True)
        return float(np.median([np.median(now[kind]) / np.median(before[kind]) for now, before in pairs]))

    @property
    def lost(self) -> tuple[int, int]:
        """Questions that brought no answer, without and with it."""
        before, now = (sum(len(one["lost"]) for one in rounds) for rounds in (self.control, self.disturbed))
        return before, now

    def percentile_ms(self, kind: str, percent: float) -> tuple[float, float]:
        """Without and with it, over all rounds."""
        return tuple(  # type: ignore[return-value]  # of two
            1e3 * float(np.percentile(np.concatenate([one[kind] for one in rounds]), percent))
            for rounds in (self.control, self.disturbed)
        )


@dataclass(frozen=True, slots=True)
class Growth:
    """A number of rooms at one site: memory, processor time, bytes, and how late the desk sees a change."""

    rooms: int
    site_mib: float
    router_mib: float
    exporter_mib: float
    site_share: float
    exporter_share: float
    bytes_per_s: float
    late_s: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Figures:
    """All that the page says.

    Attributes
    ----------
    of_machine
        A flood at another site: what the processors of one machine do to one another.
    """

    disturbances: list[Disturbance]
    of_machine: Disturbance
    seen_again_s: float
    growth: list[Growth]

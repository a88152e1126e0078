"""What the robot knows of plans: from registration itself, never from whoever asks for the move."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Guide
from shared.geometry.hexapod import PlatformPose
from shared.geometry.transform import Transform

# A bound on memory: a plan is executed before the next few are made, or never.
REMEMBERED_PLANS = 32


@dataclass(frozen=True, slots=True, eq=False)
class PlannedMove:
    """A plan as registration published it.

    Attributes
    ----------
    sha256
        Hash of the plan's bytes.
    guide_from_target_guide
        Where the guide is to go, seen from where it is.
    pivot_mm
        Centre of rotation in the top's frame, shape (3,), that both poses refer to.
    target_leg_lengths_mm
        Shape (6,), as registration computed them.
    """

    sha256: str
    case_id: str
    case_revision: int
    registration_epoch: str
    robot_boot_epoch: str
    hexapod_sha256: str
    head_extension_mm: float
    guide_from_target_guide: Transform[Guide, Guide]
    start_pose: PlatformPose
    target_pose: PlatformPose
    pivot_mm: NDArray[np.float64]
    target_leg_lengths_mm: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class EpochReport:
    """Registration's report of its newest epoch.

    Attributes
    ----------
    boot_epoch, sequence
        Which run of registration sent it, and as which of its reports.
    heard_s
        When it arrived, on the own monotonic clock.
    """

    boot_epoch: str
    sequence: int
    epoch: str
    heard_s: float


@dataclass(frozen=True, slots=True)
class RegistrationView:
    """What registration and the open case have made known so far.

    Attributes
    ----------
    newest
        Registration's newest report; None before the first.
    past_boots
        Earlier runs of registration: whatever still comes of them counts no more.
    case
        Id and revision of the open case; None before it was published.
    plans
        Hash and time of arrival of the newest plans, oldest first.
    """

    newest: EpochReport | None = None
    past_boots: frozenset[str] = frozenset()
    case: tuple[str | None, int] | None = None
    plans: tuple[tuple[str, float], ...] = ()

    @property
    def epoch(self) -> str | None:
        """The newest registration epoch; None before the first report, and when registration is known to have gone."""
        return None if self.newest is None or self.newest.heard_s == float("-inf") else self.newest.epoch

    def silent_for_s(self, now_s: float) -> float:
        """Time since registration reported its epoch; infinite before the first report."""
        return float("inf") if self.newest is None else now_s - self.newest.heard_s

    def with_epoch_report(self, report: EpochReport) -> "RegistrationView":
        """Registration reported its epoch: plans of other epochs are stale from now on. A repeat changes nothing."""
        known = self.newest
        if report.boot_epoch in self.past_boots:
            return self
        if known is None:
            return replace(self, newest=report)
        if report.boot_epoch != known.boot_epoch:
            return replace(self, newest=report, past_boots=self.past_boots | {known.boot_epoch})
        return replace(self, newest=report) if report.sequence > known.sequence else self

    def without_epoch(self) -> "RegistrationView":
        """Registration has gone, or cannot be understood: its last report does not count until it sends another."""
        return self if self.newest is None else replace(self, newest=replace(self.newest, heard_s=float("-inf")))

    def with_case(self, case_id: str | None, revision: int) -> "RegistrationView":
        """The case was opened, changed or closed."""
        return replace(self, case=(case_id, revision))

    def with_plan(self, sha256: str, now_s: float) -> "RegistrationView":
        """A plan arrived; arriving again does not make it younger."""
        if self.arrival_s(sha256) is not None:
            return self
        return replace(self, plans=(*self.plans, (sha256, now_s))[-REMEMBERED_PLANS:])

    def arrival_s(self, sha256: str) -> float | None:
        """When registration published this plan; None when it never did."""
        return next((arrived_s for known, arrived_s in self.plans if known == sha256), None)

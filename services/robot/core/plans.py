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
    hole_ids
        Holes that the move is for.
    guide_from_target_guide
        Where the guide is to go, seen from where it is.
    pivot_mm
        Centre of rotation in the top's frame, shape (3,), that both poses refer to.
    target_leg_lengths_mm
        Shape (6,), as registration computed them.
    """

    sha256: str
    hole_ids: tuple[str, ...]
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


@dataclass(frozen=True, slots=True, eq=False)
class HeardPlan:
    """A plan, and when registration published it, on the own monotonic clock."""

    plan: PlannedMove
    arrived_s: float


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
    inside
        What is in the guide or the bone by the case's record: "wire in distal", ...
    plans
        The newest plans, oldest first: what a move carries out comes from here alone.
    """

    newest: EpochReport | None = None
    past_boots: frozenset[str] = frozenset()
    case: tuple[str | None, int] | None = None
    inside: tuple[str, ...] = ()
    plans: tuple[HeardPlan, ...] = ()

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

    def with_case(self, case_id: str | None, revision: int, inside: tuple[str, ...]) -> "RegistrationView":
        """The case was opened, changed or closed, or something was put into the bone or taken out."""
        return replace(self, case=(case_id, revision), inside=inside)

    def without_case(self) -> "RegistrationView":
        """What was published of the case cannot be understood: nobody knows what is in the bone."""
        return replace(self, case=None)

    def with_plan(self, plan: PlannedMove, now_s: float) -> "RegistrationView":
        """A plan arrived; arriving again does not make it younger."""
        if self.heard_plan(plan.sha256) is not None:
            return self
        return replace(self, plans=(*self.plans, HeardPlan(plan, now_s))[-REMEMBERED_PLANS:])

    def heard_plan(self, sha256: str) -> HeardPlan | None:
        """The plan of this hash; None when registration never published it, or long ago."""
        return next((heard for heard in self.plans if heard.plan.sha256 == sha256), None)

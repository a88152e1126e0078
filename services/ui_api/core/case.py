"""A case as the event log tells it: `applied` folds one event after another into an immutable value."""

from dataclasses import dataclass, replace
from functools import singledispatch

from services.ui_api.core.event_data import (
    ApprovalWithdrawn,
    CaseOpened,
    CaseSetup,
    ImageCalibrated,
    ImageReceived,
    ImageSkipped,
    LocalisationReceived,
    PlanApproved,
    PlanMade,
    QaReported,
    SetupChanged,
    Step,
    StepRecorded,
    StepWithdrawn,
    VerificationMade,
)
from services.ui_api.core.events import Event, EventData
from services.ui_api.core.guide_moved import (
    BY_A_CHANGED_SET_UP,
    BY_A_MOVE,
    BY_A_REFERENCE,
    UNSEEN,
    GuideMoved,
    RobotWatch,
)
from services.ui_api.core.inside import TAKEN_OUT, Inside, inside_after
from services.ui_api.core.procedure import Progress, Stage, Trigger
from services.ui_api.core.robot_event_data import OperationEnded, OperationRequested, OperationStatus, RobotChanged

_AT_THE_START = Progress()
STEPS_THAT_CHANGE_THE_SETUP = frozenset({Step.MOUNT_MOVED, Step.RING_REMOUNTED})


@dataclass(frozen=True, slots=True)
class PlanEntry:
    """A plan and what became of it. `used` once a motion began, or may have begun, from it."""

    made: PlanMade
    made_at_ns: int
    approval: PlanApproved | None = None
    used: bool = False


@dataclass(frozen=True, slots=True)
class StepEntry:
    """A step that counts, by its number in the case, and what it changed: so that it can be taken back.

    `guide_moved` is that of the case then.
    """

    number: int
    recorded: StepRecorded
    before: Progress
    drilled_before: frozenset[str]
    after: Progress
    guide_moved: GuideMoved | None

    def is_undone_safely(self, now: Progress) -> bool:
        """Whether nothing but images has come since, and nothing was made stale by it."""
        unchanged = (self.after.stage, self.after.inside) == (now.stage, now.inside)
        return unchanged and self.recorded.step not in STEPS_THAT_CHANGE_THE_SETUP


@dataclass(frozen=True, slots=True)
class Case:
    """Everything the log says about a case. Lists are in the order of the log; numbers count from 1.

    Images are in the order in which they were received, the newest last: one that the gateway missed, and records
    later, takes its place among the others. Of running fluoroscopy, `frames_let_go` older frames from which nothing was
    measured are on record only. `localised_at_ns` and `skipped_at_ns` are when that was reported. `guide_moved` is the
    last time that the guide moved, or may have. What ends in `before_motion` is put back when a motion never began.
    """

    case_id: str
    opened_at_ns: int
    changed_at_ns: int
    revision: int
    setup: CaseSetup
    progress: Progress = _AT_THE_START
    stage_before_motion: Stage = Stage.POSITIONING
    guide_moved: GuideMoved | None = None
    guide_moved_before_motion: GuideMoved | None = None
    reference_id: str | None = None  # of the last reference, as an operation
    robot: RobotWatch = UNSEEN
    images: tuple[ImageReceived, ...] = ()
    frames_let_go: int = 0
    calibrations: tuple[ImageCalibrated, ...] = ()
    skipped: tuple[ImageSkipped, ...] = ()
    localisations: tuple[LocalisationReceived, ...] = ()
    skipped_at_ns: tuple[int, ...] = ()
    localised_at_ns: tuple[int, ...] = ()
    plans: tuple[PlanEntry, ...] = ()
    motions: tuple[str, ...] = ()
    verifications: tuple[VerificationMade, ...] = ()
    qa_reports: tuple[QaReported, ...] = ()
    step_entries: tuple[StepEntry, ...] = ()
    steps_recorded: int = 0
    drilled_hole_ids: frozenset[str] = frozenset()

    @property
    def hole_ids(self) -> tuple[str, ...]:
        """Holes of the nail that have a guide hole of the same id."""
        return tuple(h for h in self.setup.nail.hole_ids if h in self.setup.guide.hole_ids)

    def holes_meant_by(self, step: Step) -> tuple[str, ...]:
        """Holes that a step is about when it names none: what is taken out, is taken out wherever it is.

        What is inside was put in through holes of the parts of then, which other parts may not have.
        """
        kind = TAKEN_OUT.get(step)
        held = sorted(found.hole_id for found in self.progress.inside if found.kind is kind)
        return (*self.hole_ids, *(hole_id for hole_id in held if hole_id not in self.hole_ids))

    @property
    def steps(self) -> tuple[StepRecorded, ...]:
        """Steps that count: those that were not withdrawn."""
        return tuple(entry.recorded for entry in self.step_entries)

    @property
    def inside_beside_robot(self) -> frozenset[Inside]:
        """What is in the guide or the bone; nothing that matters once the robot was taken off and the case closed."""
        taken_off = self.progress.closed and any(step.step is Step.ROBOT_REMOVED for step in self.steps)
        return frozenset() if taken_off else self.progress.inside

    @property
    def side_of_images(self) -> str | None:
        """The side that the newest image with one states; None when none of this set-up does."""
        stated = (i.laterality for i in reversed(self.images) if i.case_revision == self.revision)
        return next((side for side in stated if side is not None), None)

    def image(self, sha256: str) -> ImageReceived | None:
        """An image of this case, by its hash; when it came twice, the later one."""
        return next((i for i in reversed(self.images) if i.image_sha256 == sha256), None)

    def calibration_of(self, image_sha256: str) -> ImageCalibrated | None:
        """The newest calibration made from an image."""
        return next((c for c in reversed(self.calibrations) if c.image_sha256 == image_sha256), None)

    def localisation_of(self, image_sha256: str) -> LocalisationReceived | None:
        """The newest localisation made from an image."""
        return next((x for x in reversed(self.localisations) if x.image_sha256 == image_sha256), None)

    def newest_localisation(self) -> LocalisationReceived | None:
        """The newest one made from the newest image that has one; one that was missed may be recorded after it."""
        places = {image.image_sha256: place for place, image in enumerate(self.images)}
        return max(self.localisations, key=lambda x: (places.get(x.image_sha256, -1), x.number), default=None)

    def skip_of(self, image_sha256: str) -> ImageSkipped | None:
        """Why an image was not calibrated or localised; None when it was, or nobody has said so."""
        return next((s for s in reversed(self.skipped) if s.image_sha256 == image_sha256), None)

    def holding(self, frames: int) -> "Case":
        """The case without the older frames of fluoroscopy from which nothing was measured; so many of all images stay.

        An hour of fluoroscopy is 108,000 frames. Some more are held until it is worth letting go of them.
        """
        surplus = len(self.images) - frames
        if surplus <= frames // 4:
            return self
        measured = {one.image_sha256 for one in self.calibrations} | {one.image_sha256 for one in self.localisations}
        measured |= {one.image_sha256 for one in self.skipped}
        older = tuple(i for i in self.images[:surplus] if not i.in_run or i.image_sha256 in measured)
        let_go = self.frames_let_go + surplus - len(older)
        return replace(self, images=older + self.images[surplus:], frames_let_go=let_go)

    def plan(self, number: int) -> PlanEntry | None:
        """A plan, by its number."""
        return self.plans[number - 1] if 1 <= number <= len(self.plans) else None

    def knows_localisation(self, image_sha256: str, registration_epoch: str) -> bool:
        """Whether a localisation is recorded already: the bus gives the last one to every late joiner."""
        return any(
            (x.image_sha256, x.registration_epoch) == (image_sha256, registration_epoch) for x in self.localisations
        )

    def staleness_of_image(self, image_sha256: str, revision: int) -> str | None:
        """Why what was measured in an image no longer holds, as a clause; None when it does hold."""
        if revision != self.revision:
            return f"it was measured at set-up revision {revision}, and the set-up is now at revision {self.revision}"
        if self.images and self.images[-1].image_sha256 != image_sha256:
            return "a newer image has arrived"
        return self.guide_moved_since(image_sha256)

    def guide_moved_since(self, image_sha256: str) -> str | None:
        """Why an image no longer shows where the guide is, as a clause; None while it does, or of an unknown image."""
        image, moved = self.image(image_sha256), self.guide_moved
        if image is None:
            return None
        if moved is not None and moved.is_after(image):
            return moved.because
        return None if image.case_revision == self.revision else BY_A_CHANGED_SET_UP


def opened_case(event: Event, data: CaseOpened, robot: RobotWatch) -> Case:
    """The case right after it was opened, beside a robot that was seen so."""
    if event.case_id is None:
        raise ValueError(f"event {event.sequence} opens a case without an id")
    return Case(event.case_id, event.at_ns, event.at_ns, revision=1, setup=data.setup, robot=robot)


def applied(case: Case, event: Event) -> Case:
    """The case after one more event of its log."""
    return replace(_after(event.data, case, event), changed_at_ns=event.at_ns)


def _moved(case: Case, trigger: Trigger) -> Case:
    return replace(case, progress=case.progress.after(trigger))


@singledispatch
def _after(data: EventData, case: Case, event: Event) -> Case:  # noqa: ARG001 - the signature all kinds share
    return case


@_after.register
def _(data: SetupChanged, case: Case, event: Event) -> Case:  # noqa: ARG001
    moved = _guide_moved(case, BY_A_CHANGED_SET_UP)
    known = replace(case, revision=data.revision, setup=data.setup, guide_moved=moved)
    return _moved(known, Trigger.SETUP_CHANGED)


@_after.register
def _(data: ImageReceived, case: Case, event: Event) -> Case:  # noqa: ARG001
    place = len(case.images)
    while place > 0 and data.precedes(case.images[place - 1]):
        place -= 1
    known = replace(case, images=(*case.images[:place], data, *case.images[place:]))
    return _moved(known, Trigger.IMAGE_RECEIVED) if place == len(case.images) else known


@_after.register
def _(data: ImageSkipped, case: Case, event: Event) -> Case:
    return replace(case, skipped=(*case.skipped, data), skipped_at_ns=(*case.skipped_at_ns, event.at_ns))


@_after.register
def _(data: ImageCalibrated, case: Case, event: Event) -> Case:  # noqa: ARG001
    return replace(case, calibrations=(*case.calibrations, data))


@_after.register
def _(data: LocalisationReceived, case: Case, event: Event) -> Case:
    at_ns = (*case.localised_at_ns, event.at_ns)
    known = replace(case, localisations=(*case.localisations, data), localised_at_ns=at_ns)
    if case.staleness_of_image(data.image_sha256, data.case_revision) is not None:
        return known
    accepted = data.verdict == "accepted"
    return _moved(known, Trigger.LOCALISATION_ACCEPTED if accepted else Trigger.LOCALISATION_REJECTED)


@_after.register
def _(data: PlanMade, case: Case, event: Event) -> Case:
    known = replace(case, plans=(*case.plans, PlanEntry(data, event.at_ns)))
    fresh = case.staleness_of_image(data.image_sha256, data.case_revision) is None
    return _moved(known, Trigger.PLAN_MADE) if fresh else known


@_after.register
def _(data: PlanApproved, case: Case, event: Event) -> Case:  # noqa: ARG001
    known = _with_plan(case, data.number, approval=data)
    return _moved(known, Trigger.PLAN_APPROVED) if data.number == len(case.plans) else known


@_after.register
def _(data: ApprovalWithdrawn, case: Case, event: Event) -> Case:  # noqa: ARG001
    plans = tuple(replace(p, approval=None) if p.made.number == data.number else p for p in case.plans)
    known = replace(case, plans=plans)
    return _moved(known, Trigger.APPROVAL_WITHDRAWN) if data.number == len(case.plans) else known


@_after.register
def _(data: OperationRequested, case: Case, event: Event) -> Case:  # noqa: ARG001
    if data.verb == "reference":
        return replace(case, reference_id=data.operation_id)
    if data.verb != "move" or data.plan_number is None:
        return case
    known = _with_plan(case, data.plan_number, used=True)
    known = replace(
        known,
        motions=(*case.motions, data.operation_id),
        stage_before_motion=case.progress.stage,
        guide_moved=_guide_moved(case, BY_A_MOVE),
        guide_moved_before_motion=case.guide_moved,
    )
    return _moved(known, Trigger.MOTION_REQUESTED)


@_after.register
def _(data: OperationEnded, case: Case, event: Event) -> Case:  # noqa: ARG001
    if data.began and data.operation_id == case.reference_id:
        return _with_guide_moved(case, BY_A_REFERENCE)
    if not case.motions or case.motions[-1] != data.operation_id:
        return case
    if data.began:
        reached = data.status is OperationStatus.SUCCEEDED
        moved = replace(case, guide_moved=_guide_moved(case, BY_A_MOVE))
        return _moved(moved, Trigger.MOTION_REACHED if reached else Trigger.MOTION_CUT_SHORT)
    plans = tuple(replace(p, used=False) if i == _last_used(case) else p for i, p in enumerate(case.plans))
    progress = replace(case.progress.after(Trigger.MOTION_NEVER_BEGAN), stage=case.stage_before_motion)
    return replace(case, plans=plans, progress=progress, guide_moved=case.guide_moved_before_motion)


@_after.register
def _(data: RobotChanged, case: Case, event: Event) -> Case:  # noqa: ARG001
    known, because = replace(case, robot=case.robot.after(data)), case.robot.unwatched_until(data)
    return known if because is None else _with_guide_moved(known, because)


@_after.register
def _(data: VerificationMade, case: Case, event: Event) -> Case:  # noqa: ARG001
    known = replace(case, verifications=(*case.verifications, data))
    if any(case.guide_moved_since(image) is not None for image in data.images):
        return known
    return _moved(known, Trigger.VERIFICATION_ACCEPTED if data.allows_drilling else Trigger.VERIFICATION_REJECTED)


@_after.register
def _(data: QaReported, case: Case, event: Event) -> Case:  # noqa: ARG001
    return replace(case, qa_reports=(*case.qa_reports, data))


@_after.register
def _(data: StepRecorded, case: Case, event: Event) -> Case:  # noqa: ARG001
    done = _with_step(case, data)
    number, drilled = case.steps_recorded + 1, case.drilled_hole_ids
    entry = StepEntry(number, data, case.progress, drilled, done.progress, case.guide_moved)
    return replace(done, step_entries=(*case.step_entries, entry), steps_recorded=entry.number)


@_after.register
def _(data: StepWithdrawn, case: Case, event: Event) -> Case:  # noqa: ARG001
    entry = case.step_entries[-1]
    if entry.number != data.number:
        raise ValueError(f"step {data.number} was withdrawn, but step {entry.number} is the last")
    # Where the guide was verified or aligned before the step, it may have moved since.
    moved = case.guide_moved != entry.guide_moved
    before = entry.before.after(Trigger.GUIDE_MAY_HAVE_MOVED) if moved else entry.before
    progress = replace(case.progress, stage=before.stage, inside=before.inside, seen=False)
    known = replace(case, step_entries=case.step_entries[:-1], drilled_hole_ids=entry.drilled_before)
    return replace(known, progress=progress)


def _with_step(case: Case, data: StepRecorded) -> Case:
    holes = frozenset(data.hole_ids or case.holes_meant_by(data.step))
    inside = inside_after(case.progress.inside, data.step, holes)
    seen = case.progress.seen and inside == case.progress.inside
    known = replace(case, progress=replace(case.progress, inside=inside, seen=seen))
    match data.step:
        case Step.DRILLED:
            drilled = replace(known, drilled_hole_ids=case.drilled_hole_ids | holes)
            all_drilled = drilled.drilled_hole_ids >= {*case.hole_ids}
            return _moved(drilled, Trigger.ALL_HOLES_DRILLED) if all_drilled else drilled
        case Step.ROBOT_REMOVED:
            return _moved(known, Trigger.ROBOT_REMOVED)
        case Step.FINISHED:
            return _moved(known, Trigger.FINISHED)
        case Step.ABANDONED:
            return _moved(known, Trigger.ABANDONED)
        case _:
            return known  # a changed mount or ring is followed by a `SetupChanged` of its own


def _with_plan(case: Case, number: int, *, approval: PlanApproved | None = None, used: bool | None = None) -> Case:
    entry = case.plans[number - 1]
    changed = replace(entry, approval=approval or entry.approval, used=entry.used if used is None else used)
    return replace(case, plans=(*case.plans[: number - 1], changed, *case.plans[number:]))


def _guide_moved(case: Case, because: str) -> GuideMoved:
    known = frozenset(image.image_sha256 for image in case.images)
    return GuideMoved(because, case.images[-1] if case.images else None, known)


def _with_guide_moved(case: Case, because: str) -> Case:
    """Beside a plan's own motion: also when that never began, images of before say nothing any more."""
    moved = _guide_moved(case, because)
    known = replace(case, guide_moved=moved, guide_moved_before_motion=moved, stage_before_motion=Stage.POSITIONING)
    return _moved(known, Trigger.GUIDE_MAY_HAVE_MOVED)


def _last_used(case: Case) -> int:
    return max(i for i, p in enumerate(case.plans) if p.used)

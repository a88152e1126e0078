"""What each kind of event says: one frozen dataclass per kind.

Fields are plain values, so that an event's JSON can be hashed and read by people for ever; what is large (part files,
localisations, overlays) lies beside the log as documents, named by their SHA-256.
"""

from dataclasses import dataclass
from enum import StrEnum

from shared.equipment import USUAL_DRILL_DIAMETER_MM


class Step(StrEnum):
    """What people did with their hands."""

    WIRES_INSERTED = "wires_inserted"
    WIRES_REMOVED = "wires_removed"
    DRILL_INSERTED = "drill_inserted"
    DRILL_REMOVED = "drill_removed"
    DRILLED = "drilled"
    SCREWS_INSERTED = "screws_inserted"
    SCREWS_REMOVED = "screws_removed"
    MOUNT_MOVED = "mount_moved"
    RING_REMOUNTED = "ring_remounted"
    ROBOT_REMOVED = "robot_removed"
    FINISHED = "finished"
    ABANDONED = "abandoned"


@dataclass(frozen=True, slots=True)
class PartUse:
    """A part file in use: its name in the catalogue (or `inline`) and the hash of its JSON text.

    Attributes
    ----------
    hole_ids
        Of a guide and a nail.
    bone
        That a nail is made for; empty where its file does not say.
    """

    name: str
    sha256: str
    hole_ids: tuple[str, ...] = ()
    bone: str = ""


@dataclass(frozen=True, slots=True)
class CaseSetup:
    """The patient set-up of a case."""

    side: str
    bone: str
    mount: str
    head_extension_mm: float
    ring: PartUse
    guide: PartUse
    nail: PartUse
    hexapod: PartUse
    guide_calibrated: bool = False
    nominal_source_to_detector_mm: float | None = None
    nominal_pixel_mm: float | None = None
    drill_diameter_mm: float = USUAL_DRILL_DIAMETER_MM


@dataclass(frozen=True, slots=True)
class GatewayStarted:
    """The gateway began to run."""

    boot_epoch: str
    version: str


@dataclass(frozen=True, slots=True)
class CaseOpened:
    """A case was opened."""

    setup: CaseSetup


@dataclass(frozen=True, slots=True)
class SetupChanged:
    """The set-up changed; everything measured under an older revision is stale."""

    revision: int
    setup: CaseSetup


@dataclass(frozen=True, slots=True)
class ImageReceived:
    """The C-arm delivered an image. `header_sha256` names its header's document (None: only its name is known).

    `sequence` is its number in the image store `store_id`; records of older versions have neither. `in_run`: it is a
    frame of running fluoroscopy, of which not every one is calibrated and localised. `laterality`: the side that
    its file states, None where it states none.
    """

    image_sha256: str
    sop_instance_uid: str
    received_at_ns: int
    case_revision: int
    header_sha256: str | None
    store_id: str | None = None
    sequence: int | None = None
    in_run: bool = False
    laterality: str | None = None

    def precedes(self, other: "ImageReceived") -> bool:
        """Whether it was received before another one, by their numbers; False where nobody can know."""
        if self.store_id is None or self.store_id != other.store_id:
            return False
        return (self.sequence or 0) < (other.sequence or 0)


@dataclass(frozen=True, slots=True)
class ImageSkipped:
    """A step was left out for an image, `calibration` or `localisation`, and why."""

    image_sha256: str
    step: str
    code: str
    message: str


@dataclass(frozen=True, slots=True)
class ImageCalibrated:
    """An image's calibration, or why it has none."""

    image_sha256: str
    verdict: str
    reason_codes: tuple[str, ...]
    document_sha256: str


@dataclass(frozen=True, slots=True)
class LocalisationReceived:
    """Registration's answer to an image."""

    number: int
    image_sha256: str
    case_revision: int
    registration_epoch: str
    verdict: str
    reason_codes: tuple[str, ...]
    document_sha256: str
    overlay_sha256: str | None


@dataclass(frozen=True, slots=True)
class PlanMade:
    """A plan, ready for approval."""

    number: int
    localisation: int
    hole_ids: tuple[str, ...]
    plan_sha256: str
    image_sha256: str
    case_revision: int


@dataclass(frozen=True, slots=True)
class PlanRefused:
    """Registration made no plan."""

    localisation: int
    hole_ids: tuple[str, ...]
    code: str
    message: str


@dataclass(frozen=True, slots=True)
class PlanApproved:
    """A surgeon's consent to exactly one plan; `authenticated_by` is how he showed who he is, None in old records."""

    number: int
    plan_sha256: str
    approved_by: str
    approved_at_ns: int
    authenticated_by: str | None = None


@dataclass(frozen=True, slots=True)
class ApprovalWithdrawn:
    """A surgeon took an approval back before any motion began from it."""

    number: int
    plan_sha256: str


@dataclass(frozen=True, slots=True)
class VerificationMade:
    """Wires or guide holes compared with the nail's hole axes.

    `passing_hole_ids` are those through which a drill would pass; None in records of older versions.
    """

    number: int
    images: tuple[str, ...]
    verdict: str
    reason_codes: tuple[str, ...]
    document_sha256: str
    passing_hole_ids: tuple[str, ...] | None = None

    @property
    def allows_drilling(self) -> bool:
        """Whether it is accepted and a drill would pass a hole."""
        return self.verdict == "accepted" and (self.passing_hole_ids is None or bool(self.passing_hole_ids))


@dataclass(frozen=True, slots=True)
class VerificationRefused:
    """There is no verification: registration could not make one, or the guide may have moved meanwhile."""

    images: tuple[str, ...]
    code: str
    message: str


@dataclass(frozen=True, slots=True)
class QaReported:
    """Imaging's quality report over images of a case, and its page for people."""

    number: int
    images: tuple[str, ...]
    verdict: str
    document_sha256: str
    page_sha256: str


@dataclass(frozen=True, slots=True)
class StepRecorded:
    """What people did with their hands. `out_of_order` steps carry the reason that was given for them."""

    step: Step
    hole_ids: tuple[str, ...]
    out_of_order: bool
    why: str


@dataclass(frozen=True, slots=True)
class StepWithdrawn:
    """A step that was recorded by mistake is taken back: it was not done."""

    number: int
    step: Step


@dataclass(frozen=True, slots=True)
class PresenceChanged:
    """A service appeared or vanished."""

    service: str
    alive: bool


@dataclass(frozen=True, slots=True)
class ImageNumbers:
    """Numbers of images in one image store, as ranges from the first to the last."""

    store_id: str
    ranges: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class CasePruned:
    """A closed case was removed by rule: the content of its events, documents that no other event names, its images.

    Attributes
    ----------
    event_ranges
        Numbers of the events that are empty now, as ranges from the first to the last.
    documents, images
        Hashes of what was deleted.
    image_numbers
        Numbers of its images, which are on record all the same.
    """

    pruned_case_id: str
    rule: str
    event_ranges: tuple[tuple[int, int], ...]
    documents: tuple[str, ...]
    images: tuple[str, ...]
    image_numbers: tuple[ImageNumbers, ...] = ()


@dataclass(frozen=True, slots=True)
class ImagesPruned:
    """Files of images were deleted by rule; the events that name these images stay."""

    rule: str
    images: tuple[str, ...]

"""What clients get: localisations, alignment and verifications."""

from typing import Literal

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import LocalisationReceived
from services.ui_api.handlers.procedure import localisation_staleness
from services.ui_api.routes.views import View, age_s
from shared.messages.base import Identifier, Sha256, UnixNanoseconds
from shared.messages.guidance import Guidance
from shared.messages.registration import (
    CArmCorrection,
    Localisation,
    LocalisationRecord,
    MountingSiteMessage,
    OffCentre,
    Verification,
    ViewAssessment,
)
from shared.messages.robot import PlatformPoseMessage

ResultValidity = Literal["current", "stale"]
# Frames follow one another within half a second, or they are single shots.
GUIDANCE_LASTS_S = 0.5
OLDEST_FRAME_S = 1.0


class Provenance(View):
    """Where a localisation comes from."""

    case_id: Identifier
    case_revision: int
    registration_epoch: Identifier
    robot_boot_epoch: Identifier | None
    robot_pose: PlatformPoseMessage | None
    sop_instance_uid: str
    received_at_ns: UnixNanoseconds
    ring_sha256: Sha256
    guide_sha256: Sha256
    nail_sha256: Sha256
    software_version: str


class LocalisationView(Localisation):
    """What `distalock locate` prints, with its number in the case, its age, whether it still holds, and provenance."""

    number: int
    age_s: float
    validity: ResultValidity
    stale_because: str | None
    mounting_site: MountingSiteMessage | None
    provenance: Provenance

    @staticmethod
    def of_record(case: Case, measured: LocalisationReceived, record: LocalisationRecord) -> "LocalisationView":
        """From the record's document."""
        clause = localisation_staleness(case, measured)
        provenance = Provenance(
            case_id=record.case_id,
            case_revision=record.case_revision,
            registration_epoch=record.registration_epoch,
            robot_boot_epoch=record.robot_boot_epoch,
            robot_pose=record.robot_pose,
            sop_instance_uid=record.image.sop_instance_uid,
            received_at_ns=record.image.received_at_ns,
            ring_sha256=record.ring_sha256,
            guide_sha256=record.guide_sha256,
            nail_sha256=record.nail_sha256,
            software_version=record.software_version,
        )
        return LocalisationView(
            **dict(record.localisation),
            number=measured.number,
            age_s=age_s(record.image.received_at_ns),
            validity="current" if clause is None else "stale",
            stale_because=clause,
            mounting_site=record.mounting_site,
            provenance=provenance,
        )


class HoleTilt(View):
    """How far a hole's axis is tilted against the X-ray through it."""

    id: str
    tilt_to_ray_deg: float


class GuidanceView(Guidance):
    """What the newest frame of running fluoroscopy said, with its age and whether it is about the moment.

    It is current while its frame is the newest image. While newer ones are on their way it is current for half a second
    after it was heard, and only if the frame itself is no older than a second. `age_s` is the frame's, on monotonic
    clocks; null when nobody knows.
    """

    age_s: float | None
    validity: ResultValidity
    stale_because: str | None

    @staticmethod
    def of(
        guidance: Guidance, heard_s_ago: float, newest_image: str | None, case_revision: int | None
    ) -> "GuidanceView":
        """From the word, and the newest image and the case's revision that there are."""
        age = aged(guidance.image_age_s, heard_s_ago)
        newest = guidance.image.sha256 == newest_image
        same_set_up = case_revision in (None, guidance.case_revision)
        young = age is not None and age <= OLDEST_FRAME_S
        current = same_set_up and (newest or (heard_s_ago <= GUIDANCE_LASTS_S and young))
        old = "of unknown age" if age is None else f"{age:.1f} s old"
        clause = (
            f"newer images have come; this word is about one that is {old} (limit {OLDEST_FRAME_S:g} s) "
            f"and was heard {heard_s_ago:.1f} s ago (limit {GUIDANCE_LASTS_S:g} s); wait for the next one"
        )
        if not same_set_up:
            clause = (
                f"the case's set-up is revision {case_revision} now, this word is about revision "
                f"{guidance.case_revision}; wait for the next one"
            )
        return GuidanceView(
            **dict(guidance),
            age_s=age,
            validity="current" if current else "stale",
            stale_because=None if current else clause,
        )


class AlignmentView(View):
    """How to turn the C-arm, from the newest localisation. Null where that one did not get so far.

    While fluoroscopy runs, `guidance` is newer: it follows every frame, a localisation takes seconds.
    """

    localisation: int
    image: Sha256
    verdict: str
    reason_codes: list[str]
    c_arm_correction_deg: CArmCorrection | None
    tilts: list[HoleTilt]
    assessment: ViewAssessment | None
    off_centre_mm: OffCentre | None
    age_s: float
    validity: ResultValidity
    stale_because: str | None
    guidance: GuidanceView | None


class VerificationView(Verification):
    """What `distalock verify` prints, with its number in the case."""

    number: int


def aged(age_s: float | None, heard_s_ago: float) -> float | None:
    """Age of an image now: what it was when it was published, and the time since; None when nobody knew it."""
    return None if age_s is None else age_s + heard_s_ago

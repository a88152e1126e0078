"""What clients get: localisations, alignment and verifications."""

import time
from typing import Literal

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import LocalisationReceived
from services.ui_api.desks.planning import localisation_staleness
from services.ui_api.routes.views import View
from shared.messages.base import Identifier, Sha256, UnixNanoseconds
from shared.messages.registration import CArmCorrection, Localisation, LocalisationRecord, Verification
from shared.messages.robot import PlatformPoseMessage

ResultValidity = Literal["current", "stale"]


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
            provenance=provenance,
        )


class HoleTilt(View):
    """How far a hole's axis is tilted against the X-ray through it."""

    id: str
    tilt_to_ray_deg: float


class AlignmentView(View):
    """How to turn the C-arm, from the newest localisation. Null where that one did not get so far."""

    localisation: int
    image: Sha256
    verdict: str
    reason_codes: list[str]
    c_arm_correction_deg: CArmCorrection | None
    tilts: list[HoleTilt]
    age_s: float
    validity: ResultValidity
    stale_because: str | None


class VerificationView(Verification):
    """What `distalock verify` prints, with its number in the case."""

    number: int


def age_s(received_at_ns: int) -> float:
    """Time since an image was received: wall clocks of hosts that keep the same time, for people only."""
    return max(0.0, (time.time_ns() - received_at_ns) / 1e9)

"""What clients send: strict, without unknown keys, units in names."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, SecretStr

from services.ui_api.core.account_rules import MOST_CHARACTERS, USER_NAME_PATTERN
from services.ui_api.core.event_data import Step
from services.ui_api.handlers.cases import SetupRequest
from shared.equipment import USUAL_DRILL_DIAMETER_MM, Bone
from shared.messages.base import Identifier, Sha256
from shared.messages.cases import DrillDiameter, HeadExtension, Mount, Side
from shared.messages.registration import VerificationOf

# At least one visible character: an approval by "  " is nobody's. No control characters: not every database keeps them.
PersonName = Annotated[
    str, Field(min_length=1, max_length=128, pattern=r"^[^\x00-\x1f\x7f]*[^\s\x00-\x1f\x7f][^\x00-\x1f\x7f]*$")
]
# Programs of before there were users name people here.
Claimed = Annotated[
    PersonName | None, Field(deprecated=True, description="Not used: the record names the user who is signed in.")
]
HoleIds = Annotated[list[Annotated[str, Field(min_length=1, max_length=64)]], Field(max_length=16)]
Password = Annotated[SecretStr, Field(min_length=1, max_length=MOST_CHARACTERS)]
# A credential of `navigator.credentials` as its toJSON() gives it: signatures and keys in base64url.
SignedByPasskey = dict[str, Any]
UserName = Annotated[str, Field(pattern=USER_NAME_PATTERN)]
Why = Annotated[str, Field(max_length=500, pattern=r"^[^\x00]*$")]
SourceToDetector = Annotated[float, Field(ge=500.0, le=2000.0, allow_inf_nan=False)]
PixelSize = Annotated[float, Field(ge=0.05, le=2.0, allow_inf_nan=False)]
PartObject = dict[str, object]
# A name in the catalogue, or the JSON object of a part file.
Part = Identifier | PartObject
DEFAULT_HEXAPOD = "hexapod-h70"


class Body(BaseModel):
    """Base of all request bodies."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class CaseBody(Body):
    """Opens a case."""

    side: Side
    bone: Bone
    mount: Mount
    nail: Part
    guide: Part
    ring: Part
    hexapod: Part = DEFAULT_HEXAPOD
    head_extension_mm: HeadExtension
    guide_calibration: PartObject | None = Field(
        None,
        description="What `distalock robot calibrate-guide` printed: the hexapod's head is then as found. Or the guide "
        "file of this very guide as measured, in place of the nominal one.",
    )
    nominal_source_to_detector_mm: SourceToDetector | None = None
    nominal_pixel_mm: PixelSize | None = None
    drill_diameter_mm: DrillDiameter = USUAL_DRILL_DIAMETER_MM
    opened_by: Claimed = None

    def request(self) -> SetupRequest:
        """As the case handler takes it."""
        return _setup_request(self)


class CasePatch(Body):
    """Changes the set-up of a case; what is left out stays as it is."""

    side: Side | None = None
    bone: Bone | None = None
    mount: Mount | None = None
    nail: Part | None = None
    guide: Part | None = None
    ring: Part | None = None
    hexapod: Part | None = None
    head_extension_mm: HeadExtension | None = None
    guide_calibration: PartObject | None = None
    nominal_source_to_detector_mm: SourceToDetector | None = None
    nominal_pixel_mm: PixelSize | None = None
    drill_diameter_mm: DrillDiameter | None = None
    changed_by: Claimed = None
    why: Why = ""

    def request(self) -> SetupRequest:
        """As the case handler takes it."""
        return _setup_request(self)


def _setup_request(body: CaseBody | CasePatch) -> SetupRequest:
    return SetupRequest(
        side=body.side,
        bone=body.bone,
        mount=body.mount,
        head_extension_mm=body.head_extension_mm,
        ring=body.ring,
        guide=body.guide,
        nail=body.nail,
        hexapod=body.hexapod,
        guide_calibration=body.guide_calibration,
        nominal_source_to_detector_mm=body.nominal_source_to_detector_mm,
        nominal_pixel_mm=body.nominal_pixel_mm,
        drill_diameter_mm=body.drill_diameter_mm,
    )


class StepBody(Body):
    """What people did with their hands. Without `hole_ids` it concerns all holes."""

    step: Literal[
        "wires_inserted",
        "wires_removed",
        "drill_inserted",
        "drill_removed",
        "drilled",
        "screws_inserted",
        "screws_removed",
        "mount_moved",
        "ring_remounted",
        "robot_removed",
        "finished",
        "abandoned",
    ]
    hole_ids: HoleIds = Field(default_factory=list)
    done_by: Claimed = None
    why: Why = Field("", description="Needed when the step is out of order.")

    def as_step(self) -> Step:
        """The step as the core knows it."""
        return Step(self.step)


class PlanBody(Body):
    """Asks for a plan from a localisation, by its number in the case."""

    localisation: int = Field(ge=1)
    hole_ids: Annotated[list[Annotated[str, Field(min_length=1, max_length=64)]], Field(min_length=1, max_length=16)]
    localisations: Annotated[list[Annotated[int, Field(ge=1)]], Field(max_length=16)] = Field(
        default_factory=list,
        description="Localisations of the same set-up to fuse with it: same revision, robot in the same place.",
    )
    verification: Annotated[int, Field(ge=1)] | None = Field(
        None, description="The last verification, of the localisation's image: its wires are brought onto the holes."
    )


class ApprovalBody(Body):
    """A surgeon's consent to the plan whose ETag is quoted in If-Match."""

    password: Password | None = Field(
        None, description="The approving surgeon's, once more. Not needed with a passkey or the simulation's token."
    )
    passkey: SignedByPasskey | None = Field(
        None,
        exclude=True,  # as a password it is no part of what tells one request from another
        description="In place of the password: the challenge of POST /users/me/passkeys/challenge, signed.",
    )
    approved_by: Claimed = None


class MotionBody(Body):
    """Starts the motion of an approved plan."""

    plan: int = Field(ge=1)
    hold_to_move: bool = Field(
        default=False, description="Motion stops unless PUT /operations/{id}/lease is repeated within its lease."
    )
    requested_by: Claimed = None


def _each_once(images: list[str]) -> list[str]:
    """The same image twice is not two measurements."""
    if len(set(images)) < len(images):
        raise ValueError(f"{len(images)} images were named and {len(set(images))} differ; name each once")
    return images


class VerificationBody(Body):
    """Asks for a verification from one image or two."""

    images: Annotated[list[Sha256], Field(min_length=1, max_length=2), AfterValidator(_each_once)]
    of: VerificationOf = Field(
        "wires", description="`wires` in the guide's holes, or `guide`: its own holes, from images without wires."
    )


class QaBody(Body):
    """Asks for a quality report over images of the case."""

    images: Annotated[list[Sha256], Field(min_length=1, max_length=32), AfterValidator(_each_once)]


class CommandBody(Body):
    """Asks the robot to reference, to acknowledge a stop, or to reset; may be left out."""

    requested_by: Claimed = None

"""Errors and refusals of the whole project.

An *expected* refusal (an image that does not allow an answer, a motion that is not approved) is a value: `Rejected`,
which carries one `Reason` or more. An exception is for what the caller did not prepare for. The tree::

    DistalockError
    ├── InputError            what a person or another program handed in cannot be used
    │   ├── ImageUnreadable   not an image, truncated, unsupported or of the wrong polarity
    │   └── PartFileInvalid   a ring, guide, nail or hexapod file breaks its schema
    ├── BusError              the message bus did not carry the message
    │   ├── BusUnavailable    no router could be reached
    │   └── NoReply           a query brought no answer: this does not mean that it was not carried out
    ├── DeviceError           a device (hexapod controller, C-arm) did not do what its protocol says
    ├── RecordUnavailable     the case record cannot be written now
    └── ConfigurationError    settings, ports or folders that do not allow a start
        └── ServiceAlreadyRuns  another service of the same name is in the room
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

T_co = TypeVar("T_co", covariant=True)


class ReasonCode(StrEnum):
    """Why an image was rejected. Stable: consoles and records rely on the codes."""

    IMAGE_UNUSABLE = "image_unusable"
    SATURATED = "saturated"
    MOTION_BLUR = "motion_blur"
    RING_NOT_FOUND = "ring_not_found"
    RING_AMBIGUOUS = "ring_ambiguous"
    RING_TOO_FEW_BALLS = "ring_too_few_balls"
    CALIBRATION_EXTRAPOLATED = "calibration_extrapolated"
    GUIDE_NOT_FOUND = "guide_not_found"
    GUIDE_AMBIGUOUS = "guide_ambiguous"
    GUIDE_TOO_FEW_BALLS = "guide_too_few_balls"
    GUIDE_MODEL_MISMATCH = "guide_model_mismatch"
    NAIL_NOT_FOUND = "nail_not_found"
    HOLE_NOT_VISIBLE = "hole_not_visible"
    NAIL_MODEL_MISMATCH = "nail_model_mismatch"
    MIRROR_AMBIGUOUS = "mirror_ambiguous"
    UNCERTAINTY_TOO_LARGE = "uncertainty_too_large"
    TILT_TOO_LARGE = "tilt_too_large"
    WIRE_NOT_FOUND = "wire_not_found"
    IMAGES_DISAGREE = "images_disagree"
    IMAGE_PROCESSED = "image_processed"


@dataclass(frozen=True, slots=True)
class Reason:
    """One reason for a refusal.

    Attributes
    ----------
    code
        Stable name of the reason.
    message
        One sentence for people: what was measured, the limit, what to do.
    """

    code: ReasonCode
    message: str


@dataclass(frozen=True, slots=True)
class Accepted(Generic[T_co]):
    """A result that may be used."""

    value: T_co


@dataclass(frozen=True, slots=True)
class Rejected:
    """A refusal that was to be expected, with its reasons (at least one)."""

    reasons: tuple[Reason, ...]


class DistalockError(Exception):
    """Root of all exceptions that this project raises on purpose.

    Attributes
    ----------
    code
        Stable name of the kind of error, as it appears in problem documents and logs.
    """

    code: str = "error"


class InputError(DistalockError):
    """What a person or another program handed in cannot be used."""

    code = "bad_input"


class ImageUnreadable(InputError):
    """The file is not an image that can be measured."""

    code = "image_unreadable"


class PartFileInvalid(InputError):
    """A ring, guide, nail or hexapod file breaks its schema."""

    code = "part_file_invalid"


class BusError(DistalockError):
    """The message bus did not carry the message."""

    code = "bus_error"


class BusUnavailable(BusError):
    """No router could be reached."""

    code = "bus_unavailable"


class NoReply(BusError):
    """A query brought no answer. This does not mean that it was not carried out."""

    code = "no_reply"


class DeviceError(DistalockError):
    """A device did not do what its protocol says."""

    code = "device_error"


class RecordUnavailable(DistalockError):
    """The case record cannot be written now: nothing was written."""

    code = "record_unavailable"


class ConfigurationError(DistalockError):
    """Settings, ports or folders that do not allow a start."""

    code = "configuration_error"


class ServiceAlreadyRuns(ConfigurationError):
    """Another service of the same name is in the room, which has place for one."""

    code = "service_already_runs"

"""Asking for what was missed: which images imaging has stored, what became of each, and why one was left out."""

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field

from shared.messages.base import Identifier, Message, MessageModel
from shared.messages.imaging import CalibrationMessage, FrameHeader, ImageReference
from shared.messages.registration import LocalisationRecord

Sequence = Annotated[int, Field(ge=0)]
MOST_IMAGES = 64
"""In one reply."""


class Step(StrEnum):
    """What is made of every single shot of an open case."""

    CALIBRATION = "calibration"
    LOCALISATION = "localisation"


class SkipCode(StrEnum):
    """Why a step was left out for an image; stable names."""

    NO_CASE = "no_case"
    SET_UP_CHANGED = "set_up_changed"
    SUPERSEDED = "superseded"
    FAULT = "fault"
    FILE_MISSING = "file_missing"
    ANOTHER_STORE = "another_store"


class Skip(MessageModel):
    """A step that was left out for an image, and why, in one sentence for people."""

    step: Step
    code: SkipCode
    message: str


class StoredImage(MessageModel):
    """An image that imaging has stored, and how far its calibration has come."""

    header: FrameHeader
    calibration: Literal["pending", "done", "skipped"]
    skip: Skip | None = None


class StoredImagesRequest(Message):
    """Asks imaging which images it has stored after a number."""

    schema_name: Literal["distalock/stored-images-request/1"] = Field(
        "distalock/stored-images-request/1", alias="schema"
    )
    after: Sequence
    most: int = Field(MOST_IMAGES, ge=1, le=MOST_IMAGES)


class StoredImagesReply(Message):
    """Images in the order of their numbers, and the number of the newest there is; numbers have no gap."""

    schema_name: Literal["distalock/stored-images-reply/1"] = Field("distalock/stored-images-reply/1", alias="schema")
    store_id: Identifier
    newest: Sequence
    images: tuple[StoredImage, ...]


class LocalisationRequest(Message):
    """Asks registration for the localisation of a calibrated image, or why there is none.

    Attributes
    ----------
    calibration
        Of the image, as imaging published it: it names image and set-up.
    newest
        The newest image of the case that is on record: registration may have started since.
    open_case_id, open_case_revision
        What the gateway has announced as open; None when nothing is.
    """

    schema_name: Literal["distalock/localisation-request/1"] = Field("distalock/localisation-request/1", alias="schema")
    calibration: CalibrationMessage
    newest: ImageReference
    open_case_id: Identifier | None = None
    open_case_revision: int = Field(0, ge=0)


class LocalisationReply(Message):
    """The localisation, or why there is none; neither while registration works on it."""

    schema_name: Literal["distalock/localisation-reply/1"] = Field("distalock/localisation-reply/1", alias="schema")
    record: LocalisationRecord | None = None
    skip: Skip | None = None

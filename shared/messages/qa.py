"""Quality control of ring and C-arm: the report, and how imaging is asked for one."""

from typing import Literal

from pydantic import Field

from shared.messages.base import Finite, Identifier, Message, MessageModel, ReasonMessage, Sha256, Vector3, Verdict


class QaImage(MessageModel):
    """One image; figures are None when it was refused."""

    name: str
    verdict: Verdict
    reasons: tuple[ReasonMessage, ...] = ()
    balls_found: int = 0
    source_mm: Vector3 | None = Field(None, description="Focal spot in the ring's frame.")
    source_deviation_mm: Vector3 | None = None
    mirrored: bool | None = None
    reprojection_rms_px: Finite | None = None
    distortion_residual_px: Finite | None = None
    central_deviation_px: Finite | None = None


class QaBall(MessageModel):
    """One ball of the ring over all accepted images."""

    id: str
    seen: int
    shift_x_mm: Finite = Field(description="Middle residual over the images, in the frame of the ring.")
    shift_y_mm: Finite
    rms_mm: Finite
    sigmas: Finite = Field(description="Length of the median over its standard error.")
    flagged: bool


class QaDrift(MessageModel):
    """What changed since the last report."""

    since: str
    source_mm: Vector3
    distortion_rms_px: Finite
    worst_ball: str
    worst_ball_mm: Finite


class QaReport(Message):
    """The whole report."""

    schema_name: Literal["distalock/qa/1"] = Field("distalock/qa/1", alias="schema")
    made_at: str
    software_version: str
    ring_sha256: str
    verdict: Literal["good", "attention"]
    findings: tuple[str, ...]
    images: tuple[QaImage, ...]
    balls: tuple[QaBall, ...]
    mean_source_mm: Vector3 | None
    distortion_px: tuple[tuple[Finite, Finite], ...] = Field(
        description="Mean distortion at 9 x 9 places of the ring's plane, in its frame, without shift, turn and scale."
    )
    drift: QaDrift | None


class QaRequest(Message):
    """Asks imaging for a report over images that it keeps."""

    schema_name: Literal["distalock/qa-request/1"] = Field("distalock/qa-request/1", alias="schema")
    case_id: Identifier
    image_sha256: tuple[Sha256, ...] = Field(min_length=1, max_length=32)


class QaReply(Message):
    """A report and its page for people (HTML), or why there is none (unknown image, no ring, ...)."""

    schema_name: Literal["distalock/qa-reply/1"] = Field("distalock/qa-reply/1", alias="schema")
    code: str = ""
    message: str = ""
    report: QaReport | None = None
    page: str = ""

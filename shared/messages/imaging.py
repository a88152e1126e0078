"""What imaging publishes: frames (header beside the raw pixels) and calibrations."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shared.geometry.calibration import Aperture, BallCandidates, CArmCalibration
from shared.geometry.camera import DisplacementField, PinholeCamera
from shared.geometry.frames import Camera, Ring
from shared.messages.base import (
    Finite,
    Identifier,
    Matrix3,
    Message,
    MessageInvalid,
    MessageModel,
    ReasonMessage,
    Sha256,
    UnixNanoseconds,
    Verdict,
    is_empty,
)
from shared.messages.geometry import TransformMessage, matrix3

Pixels = NDArray[np.float32]
ImageAge = Annotated[float | None, Field(ge=0.0, allow_inf_nan=False)]
_SEQUENCE = "Number in the image store, which gives one to every image: from 1, without a gap, over all restarts."
_STORE_ID = "Names the image store in which `sequence` counts. Images of two stores have no order."
_AGE = (
    "Time since the image was received, in seconds on monotonic clocks, when this message was published. None: imaging "
    "has started anew since then, and nobody knows."
)
RunInterval = Annotated[float | None, Field(gt=0.0, allow_inf_nan=False)]
_RUN_INTERVAL = (
    "Present when the image is part of a run of images (running fluoroscopy): it was received within this time after "
    "the image before it, in seconds. The run ends when no image follows within this time. The first image of a run "
    "has none, and neither has a single shot."
)


class ImageReference(MessageModel):
    """Which image a result was measured in."""

    sha256: Sha256
    sop_instance_uid: str
    sequence: int = Field(ge=0, description=_SEQUENCE)
    received_at_ns: UnixNanoseconds = Field(description="For people: never compared.")
    run_interval_s: RunInterval = Field(None, description=_RUN_INTERVAL)
    store_id: Identifier | None = Field(None, description=_STORE_ID)

    def precedes(self, other: "ImageReference") -> bool:
        """Whether this image was received before the other one; False when nobody can know. No clock is asked."""
        return self.store_id is not None and self.store_id == other.store_id and self.sequence < other.sequence


class FrameHeader(Message):
    """Describes one image; travels as the attachment of its pixels.

    The pixels are little-endian float32, row by row, normalised so that darker (smaller) is denser, otherwise as the
    C-arm sent them: never resampled, never un-mirrored.
    """

    schema_name: Literal["distalock/frame/1"] = Field("distalock/frame/1", alias="schema")
    sha256: Sha256 = Field(description="Of the stored file, DICOM as received or as made by imaging.")
    sop_instance_uid: str
    sequence: int = Field(ge=0, description=_SEQUENCE)
    boot_epoch: Identifier
    received_at_ns: UnixNanoseconds = Field(description="For people: never compared.")
    width_px: int = Field(gt=0, le=8192)
    height_px: int = Field(gt=0, le=8192)
    pixel_format: Literal["float32"] = "float32"
    bits_stored: int = Field(gt=0, le=16)
    case_id: Identifier | None
    case_revision: int = Field(ge=0)
    manufacturer: str = ""
    model_name: str = ""
    nominal_source_to_detector_mm: Finite
    nominal_pixel_mm: Finite
    positioner_primary_angle_deg: Finite | None = None
    positioner_secondary_angle_deg: Finite | None = None
    laterality: Literal["left", "right"] | None = Field(
        None, description="Side of the body, as the file states it.", exclude_if=lambda side: side is None
    )
    run_interval_s: RunInterval = Field(None, description=_RUN_INTERVAL)
    focal_spot_mm: Finite | None = Field(None, exclude_if=lambda spot: spot is None)
    inverted: bool = Field(
        default=False,
        description="Pixels are reversed against what the file states.",
        exclude_if=lambda inverted: not inverted,
    )
    notes: tuple[str, ...] = Field(
        (), description="Header values that were ignored, and nominal values that were assumed.", exclude_if=is_empty
    )
    store_id: Identifier | None = Field(None, description=_STORE_ID)
    age_s: ImageAge = Field(None, description=_AGE)

    def reference(self) -> ImageReference:
        """Name this image in a result."""
        return ImageReference(
            sha256=self.sha256,
            sop_instance_uid=self.sop_instance_uid,
            sequence=self.sequence,
            received_at_ns=self.received_at_ns,
            run_interval_s=self.run_interval_s,
            store_id=self.store_id,
        )

    def pixels(self, payload: bytes) -> Pixels:
        """Raw bytes to an array, shape (height, width); raises `MessageInvalid` when the length does not fit."""
        expected = self.width_px * self.height_px * 4
        if len(payload) != expected:
            raise MessageInvalid(f"frame {self.sha256[:12]} has {len(payload)} bytes of pixels, expected {expected}")
        return np.frombuffer(payload, dtype="<f4").reshape(self.height_px, self.width_px)


class BallMessage(MessageModel):
    """One dark disc; `ring_index` is None when it is not a ball of the ring."""

    x_px: Finite
    y_px: Finite
    radius_px: Finite
    contrast: Finite
    standard_deviation_px: Finite
    ring_index: int | None


class DisplacementFieldMessage(MessageModel):
    """Distortion on a regular grid, row by row."""

    origin_px: tuple[Finite, Finite]
    spacing_px: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    rows: int = Field(ge=4, le=512)
    columns: int = Field(ge=4, le=512)
    displacement_x_px: tuple[Finite, ...]
    displacement_y_px: tuple[Finite, ...]
    standard_deviation_px: tuple[Finite, ...]


class CalibrationValues(MessageModel):
    """`CArmCalibration` on the wire."""

    width_px: int
    height_px: int
    mirrored: bool
    intrinsic_matrix_px: Matrix3
    camera_from_ring: TransformMessage
    distortion: DisplacementFieldMessage
    source_covariance_mm2: Matrix3
    balls: tuple[BallMessage, ...]
    balls_expected: int
    distortion_residual_px: Finite
    reprojection_rms_px: Finite
    runner_up_margin: Finite
    aperture: tuple[Finite, Finite, Finite] | None = Field(description="Centre x, y and radius in pixels.")
    focal_spot_mm: Finite | None = Field(None, exclude_if=lambda spot: spot is None)

    @staticmethod
    def of(calibration: CArmCalibration) -> "CalibrationValues":
        """From the core's value."""
        c, b, d = calibration, calibration.balls, calibration.distortion
        return CalibrationValues(
            width_px=c.width_px,
            height_px=c.height_px,
            mirrored=c.mirrored,
            intrinsic_matrix_px=matrix3(c.camera.intrinsic_matrix_px),
            camera_from_ring=TransformMessage.of(c.camera_from_ring, Camera, Ring),
            distortion=_field_message(d),
            source_covariance_mm2=matrix3(c.source_covariance_mm2),
            balls=tuple(
                BallMessage(
                    x_px=float(b.centre_px[i, 0]),
                    y_px=float(b.centre_px[i, 1]),
                    radius_px=float(b.radius_px[i]),
                    contrast=float(b.contrast[i]),
                    standard_deviation_px=float(b.standard_deviation_px[i]),
                    ring_index=int(b.ring_index[i]) if b.ring_index[i] >= 0 else None,
                )
                for i in range(len(b.radius_px))
            ),
            balls_expected=c.balls_expected,
            distortion_residual_px=c.distortion_residual_px,
            reprojection_rms_px=c.reprojection_rms_px,
            runner_up_margin=c.runner_up_margin,
            aperture=None if c.aperture is None else (*c.aperture.centre_px, c.aperture.radius_px),
            focal_spot_mm=c.focal_spot_mm,
        )

    def calibration(self) -> CArmCalibration:
        """To the core's value."""
        return CArmCalibration(
            width_px=self.width_px,
            height_px=self.height_px,
            mirrored=self.mirrored,
            camera=PinholeCamera(np.array(self.intrinsic_matrix_px)),
            camera_from_ring=self.camera_from_ring.transform(Camera, Ring),
            distortion=_field(self.distortion),
            source_covariance_mm2=np.array(self.source_covariance_mm2),
            balls=_candidates(self.balls),
            balls_expected=self.balls_expected,
            distortion_residual_px=self.distortion_residual_px,
            reprojection_rms_px=self.reprojection_rms_px,
            runner_up_margin=self.runner_up_margin,
            aperture=None if self.aperture is None else Aperture(self.aperture[:2], self.aperture[2]),
            focal_spot_mm=self.focal_spot_mm,
        )


class CalibrationMessage(Message):
    """What one image said of the C-arm, or why it said nothing."""

    schema_name: Literal["distalock/calibration/1"] = Field("distalock/calibration/1", alias="schema")
    image: ImageReference
    case_id: Identifier | None
    case_revision: int = Field(ge=0)
    ring_sha256: Sha256 | None
    software_version: str
    verdict: Verdict
    reasons: tuple[ReasonMessage, ...]
    values: CalibrationValues | None
    elapsed_ms: Finite


def _floats(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(float(v) for v in values.ravel())


def _field_message(d: DisplacementField) -> DisplacementFieldMessage:
    rows, columns = d.standard_deviation_px.shape
    return DisplacementFieldMessage(
        origin_px=(float(d.origin_px[0]), float(d.origin_px[1])),
        spacing_px=d.spacing_px,
        rows=rows,
        columns=columns,
        displacement_x_px=_floats(d.displacement_px[..., 0]),
        displacement_y_px=_floats(d.displacement_px[..., 1]),
        standard_deviation_px=_floats(d.standard_deviation_px),
    )


def _field(m: DisplacementFieldMessage) -> DisplacementField:
    shape = (m.rows, m.columns)
    displacement = np.stack(
        [np.array(m.displacement_x_px).reshape(shape), np.array(m.displacement_y_px).reshape(shape)], axis=-1
    )
    return DisplacementField(
        np.array(m.origin_px), m.spacing_px, displacement, np.array(m.standard_deviation_px).reshape(shape)
    )


def _candidates(balls: tuple[BallMessage, ...]) -> BallCandidates:
    return BallCandidates(
        centre_px=np.array([(b.x_px, b.y_px) for b in balls], dtype=np.float64).reshape(-1, 2),
        radius_px=np.array([b.radius_px for b in balls], dtype=np.float64),
        contrast=np.array([b.contrast for b in balls], dtype=np.float64),
        standard_deviation_px=np.array([b.standard_deviation_px for b in balls], dtype=np.float64),
        ring_index=np.array([-1 if b.ring_index is None else b.ring_index for b in balls], dtype=np.int64),
    )

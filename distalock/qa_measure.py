"""What quality control measures in ring images: each ball's residuals, the focal spot, the distortion, their drift."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from shared.errors import Reason
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.parts import RingPart
from shared.xray.aperture import find_usable_area
from shared.xray.measurement import MeasurementSettings, measure_balls

Array = NDArray[np.float64]
FloatImage = NDArray[np.float32]
Finite = Annotated[float, Field(allow_inf_nan=False)]

SHIFT_LIMIT_MM: Final = 0.05
SHIFT_SIGMAS: Final = 5.0
SEEN_LIMIT: Final = 0.5
SOURCE_DRIFT_LIMIT_MM: Final = 3.0
DISTORTION_DRIFT_LIMIT_PX: Final = 1.0
LEAST_IMAGES: Final = 3
_GRID = np.stack(np.meshgrid(np.linspace(-80.0, 80.0, 9), np.linspace(-80.0, 80.0, 9)), axis=-1).reshape(-1, 2)


class QaModel(BaseModel):
    """Base of the report: frozen, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


class QaReason(QaModel):
    """Why an image was refused."""

    code: str
    message: str


class QaImage(QaModel):
    """One image; figures are None when it was refused."""

    name: str
    verdict: Literal["accepted", "rejected"]
    reasons: tuple[QaReason, ...] = ()
    balls_found: int = 0
    source_mm: tuple[Finite, Finite, Finite] | None = Field(None, description="Focal spot in the ring's frame.")
    source_deviation_mm: tuple[Finite, Finite, Finite] | None = None
    mirrored: bool | None = None
    reprojection_rms_px: Finite | None = None
    distortion_residual_px: Finite | None = None
    central_deviation_px: Finite | None = None


class QaBall(QaModel):
    """One ball of the ring over all accepted images."""

    id: str
    seen: int
    shift_x_mm: Finite = Field(description="Middle residual over the images, in the frame of the ring.")
    shift_y_mm: Finite
    rms_mm: Finite
    sigmas: Finite = Field(description="Length of the mean over its standard error.")
    flagged: bool


class QaDrift(QaModel):
    """What changed since the last report."""

    since: str
    source_mm: tuple[Finite, Finite, Finite]
    distortion_rms_px: Finite
    worst_ball: str
    worst_ball_mm: Finite


class QaReport(QaModel):
    """The whole report."""

    schema_name: Literal["distalock/qa/1"] = Field("distalock/qa/1", alias="schema")
    made_at: str
    software_version: str
    ring_sha256: str
    verdict: Literal["good", "attention"]
    findings: tuple[str, ...]
    images: tuple[QaImage, ...]
    balls: tuple[QaBall, ...]
    mean_source_mm: tuple[Finite, Finite, Finite] | None
    distortion_px: tuple[tuple[Finite, Finite], ...] = Field(
        description="Mean distortion at 9 x 9 places of the ring's plane, in its frame, without shift, turn and scale."
    )
    drift: QaDrift | None


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """One accepted image: residuals of the ring's balls in the ring's frame, NaN where not seen, shape (balls, 2)."""

    image: QaImage
    calibration: CArmCalibration
    residual_mm: Array
    deviation_mm: Array


def rejected_image(name: str, reasons: Sequence[Reason]) -> QaImage:
    """An image that was refused, as the report shows it."""
    shown = tuple(QaReason(code=r.code, message=r.message) for r in reasons)
    return QaImage(name=name, verdict="rejected", reasons=shown)


def measured_image(name: str, calibration: CArmCalibration, ring: RingPart, pixels: FloatImage) -> Measured:
    """Residual of each ball: from where the calibration puts it to where it was measured in the image as received."""
    centre_px, deviation_px = _every_ball(calibration, ring, pixels)
    camera = calibration.camera_from_ring.points(ring.balls.position_mm)
    off_px = calibration.distortion.undistort(centre_px) - calibration.camera.project(camera)
    mm_per_px = camera[:, 2] / calibration.camera.focal_length_px
    residual = off_px * mm_per_px[:, None] @ calibration.camera_from_ring.rotation[:2, :2]
    deviation = deviation_px * mm_per_px
    source = calibration.camera_from_ring.inverse().translation_mm
    middle = np.array([[0.5 * (calibration.width_px - 1), 0.5 * (calibration.height_px - 1)]])
    image = QaImage(
        name=name,
        verdict="accepted",
        balls_found=calibration.balls_found,
        source_mm=_three(source),
        source_deviation_mm=_three(np.sqrt(np.diag(calibration.source_covariance_mm2))),
        mirrored=calibration.mirrored,
        reprojection_rms_px=calibration.reprojection_rms_px,
        distortion_residual_px=calibration.distortion_residual_px,
        central_deviation_px=float(calibration.distortion.standard_deviation_at(middle)[0]),
    )
    return Measured(image, calibration, residual, deviation)


def _every_ball(calibration: CArmCalibration, ring: RingPart, pixels: FloatImage) -> tuple[Array, Array]:
    """Centres of the ring's balls and their deviations, NaN where not seen, shapes (balls, 2) and (balls,).

    A ball that disagrees with all the rest takes no part in the calibration; here it is what is looked for.
    """
    balls = calibration.balls
    named = balls.ring_index != NOT_OF_THE_RING
    index = balls.ring_index[named]
    centre, deviation = np.full((len(ring.balls), 2), np.nan), np.full(len(ring.balls), np.nan)
    centre[index], deviation[index] = balls.centre_px[named], balls.standard_deviation_px[named]
    missing = np.flatnonzero(np.isnan(deviation))
    upright = np.ascontiguousarray(pixels[:, ::-1]) if calibration.mirrored else pixels
    radius = np.array([_usual_radius(calibration, ring, diameter) for diameter in ring.balls.diameter_mm])
    again = measure_balls(
        upright,
        calibration.image_from_camera(calibration.camera_from_ring.points(ring.balls.position_mm[missing])),
        radius[missing],
        np.concatenate([balls.centre_px[~named], centre[index]]),
        np.concatenate([balls.radius_px[~named], radius[index]]),
        MeasurementSettings(reach_px=5.0, drift_px=0.6, contrast_to_sd=8.0),
        find_usable_area(upright).mask,
    )
    centre[missing[again.seen]] = again.centre_px[again.seen]
    deviation[missing[again.seen]] = again.standard_deviation_px[again.seen]
    return centre, deviation


def _usual_radius(calibration: CArmCalibration, ring: RingPart, diameter_mm: float) -> float:
    """Middle radius of the shadows of balls of one size, in pixels."""
    balls = calibration.balls
    named = balls.ring_index != NOT_OF_THE_RING
    same = ring.balls.diameter_mm[balls.ring_index[named]] == diameter_mm
    radii = balls.radius_px[named]
    return float(np.median(radii[same] if same.any() else radii))


def ball_table(measured: Sequence[Measured], ring: RingPart) -> tuple[QaBall, ...]:
    """Each ball over all images; one that is always off in the same direction is not where the ring's file says."""
    rows = []
    for k, name in enumerate(ring.balls.ids):
        residual = np.array([m.residual_mm[k] for m in measured]).reshape(-1, 2)
        deviation = np.array([m.deviation_mm[k] for m in measured])
        there = np.isfinite(deviation)
        count = int(there.sum())
        shift = np.median(residual[there], axis=0) if count else np.zeros(2)
        rms = float(np.sqrt(np.mean(np.square(residual[there])))) if count else 0.0
        # A median of Gaussians scatters 1.25 times as much as their mean; it does not mind the one image with a cover.
        error = 1.25 * float(np.sqrt(np.median(np.square(deviation[there])) / count)) if count else 1.0
        length = float(np.hypot(*shift))
        moved = count >= LEAST_IMAGES and length > SHIFT_LIMIT_MM and length > SHIFT_SIGMAS * error
        rarely = len(measured) >= LEAST_IMAGES and count < SEEN_LIMIT * len(measured)
        rows.append(
            QaBall(
                id=name,
                seen=count,
                shift_x_mm=float(shift[0]),
                shift_y_mm=float(shift[1]),
                rms_mm=rms,
                sigmas=length / error,
                flagged=bool(moved or rarely),
            )
        )
    return tuple(rows)


def mean_distortion(measured: Sequence[Measured]) -> tuple[tuple[float, float], ...]:
    """Mean distortion on the ring's plane, in its frame, in pixels: what a similarity does not explain."""
    if not measured:
        return ()
    fields = []
    for one in measured:
        calibration = one.calibration
        plane = np.column_stack([_GRID, np.zeros(len(_GRID))])
        ideal = calibration.camera.project(calibration.camera_from_ring.points(plane))
        image = calibration.distortion.distort(ideal)
        fields.append(_without_similarity(_GRID, image @ calibration.camera_from_ring.rotation[:2, :2]))
    return tuple((float(x), float(y)) for x, y in np.mean(fields, axis=0))


def _without_similarity(plane_mm: Array, pixel: Array) -> Array:
    plane, image = plane_mm @ np.array([1.0, 1.0j]), pixel @ np.array([1.0, 1.0j])
    design = np.column_stack([plane, np.ones(len(plane))])
    solution, *_ = np.linalg.lstsq(design, image, rcond=None)
    rest = image - design @ solution
    return np.stack([rest.real, rest.imag], axis=1)


def drift_between(now: QaReport, before: QaReport) -> QaDrift | None:
    """Changes since an earlier report of the same ring; None when one of them has no accepted image."""
    if now.mean_source_mm is None or before.mean_source_mm is None:
        return None
    source = np.array(now.mean_source_mm) - np.array(before.mean_source_mm)
    change = np.array(now.distortion_px) - np.array(before.distortion_px)
    shifts = {b.id: np.hypot(*_shift(b, o)) for b, o in zip(now.balls, before.balls, strict=True) if b.seen and o.seen}
    worst = max(shifts, key=lambda name: float(shifts[name]), default="")
    return QaDrift(
        since=before.made_at,
        source_mm=_three(source),
        distortion_rms_px=float(np.sqrt(np.mean(np.square(change)))),
        worst_ball=worst,
        worst_ball_mm=float(shifts.get(worst, 0.0)),
    )


def _shift(ball: QaBall, other: QaBall) -> tuple[float, float]:
    return ball.shift_x_mm - other.shift_x_mm, ball.shift_y_mm - other.shift_y_mm


def findings(images: Sequence[QaImage], balls: Sequence[QaBall], drift: QaDrift | None) -> tuple[str, ...]:
    """What a person should look at, each with what was measured, the limit and the remedy."""
    found = [f"{i.name} was refused: {i.reasons[0].message}" for i in images if i.verdict == "rejected" and i.reasons]
    accepted = sum(i.verdict == "accepted" for i in images)
    for ball in balls:
        if not ball.flagged:
            continue
        if ball.seen < SEEN_LIMIT * accepted:
            found.append(
                f"ball {ball.id} was seen in {ball.seen} of {accepted} images (at least {SEEN_LIMIT:.0%}); "
                "look whether it is lost or always covered"
            )
        else:
            found.append(
                f"ball {ball.id} is {np.hypot(ball.shift_x_mm, ball.shift_y_mm):.3f} mm from where the ring's file "
                f"puts it (limit {SHIFT_LIMIT_MM:g} mm, {ball.sigmas:.0f} standard errors); measure or replace the ring"
            )
    return (*found, *_drift_findings(drift))


def _drift_findings(drift: QaDrift | None) -> tuple[str, ...]:
    if drift is None:
        return ()
    found = []
    across = float(np.hypot(*drift.source_mm[:2]))
    if across > SOURCE_DRIFT_LIMIT_MM:
        found.append(
            f"the focal spot moved {across:.1f} mm across since {drift.since} (limit {SOURCE_DRIFT_LIMIT_MM:g} mm at "
            "the same angle of the C-arm); the ring may have been mounted anew, else have the C-arm serviced"
        )
    if drift.distortion_rms_px > DISTORTION_DRIFT_LIMIT_PX:
        found.append(
            f"the distortion changed by {drift.distortion_rms_px:.2f} px rms since {drift.since} (limit "
            f"{DISTORTION_DRIFT_LIMIT_PX:g} px); was the C-arm at the same angle?"
        )
    if drift.worst_ball_mm > 2.0 * SHIFT_LIMIT_MM:
        found.append(
            f"ball {drift.worst_ball} moved {drift.worst_ball_mm:.3f} mm since {drift.since} (limit "
            f"{2.0 * SHIFT_LIMIT_MM:g} mm); check the ring"
        )
    return tuple(found)


def image_files(folder: Path) -> list[Path]:
    """Image files of a folder, by name."""
    kinds = {".png", ".tif", ".tiff", ".dcm"}
    return sorted(f for f in folder.iterdir() if f.is_file() and f.suffix.lower() in kinds)


def _three(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])

"""The quality report: from calibrated images to findings for a person to check."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.quality import (
    Residuals,
    ball_statistics,
    mean_distortion,
    residuals_of,
)
from services.imaging.core.tuning import QUALITY_CONTROL
from shared.errors import Reason, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import RingPart
from shared.messages.base import ReasonMessage
from shared.messages.geometry import vector3
from shared.messages.qa import QaBall, QaDrift, QaImage, QaReport
from shared.runtime.lifecycle import software_version


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """An image to examine: grey values as received, darker is denser, shape (rows, columns)."""

    name: str
    pixels: NDArray[np.float32]
    nominal: NominalGeometry


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """One accepted image, as the report shows it and with all that was measured in it."""

    image: QaImage
    residuals: Residuals
    pixels: NDArray[np.float32]

    @property
    def calibration(self) -> CArmCalibration:
        """What the image says of the C-arm."""
        return self.residuals.calibration


@dataclass(frozen=True, slots=True, eq=False)
class Examined:
    """All images, and those of them that were accepted."""

    images: tuple[QaImage, ...]
    measured: tuple[Measured, ...]


def examine(shots: Iterable[Shot | QaImage], ring: RingPart) -> Examined:
    """Calibrate images of a ring; those that were refused before (`rejected_image`) only take their place."""
    images: list[QaImage] = []
    measured: list[Measured] = []
    for shot in shots:
        if isinstance(shot, QaImage):
            images.append(shot)
            continue
        outcome = calibrate_image(shot.pixels, ring, shot.nominal)
        if isinstance(outcome, Rejected):
            images.append(rejected_image(shot.name, outcome.reasons))
            continue
        residuals = residuals_of(outcome.value, ring, shot.pixels)
        images.append(_accepted_image(shot.name, outcome.value))
        measured.append(Measured(images[-1], residuals, shot.pixels))
    return Examined(tuple(images), tuple(measured))


def rejected_image(name: str, reasons: Sequence[Reason]) -> QaImage:
    """An image that was refused, as the report shows it."""
    return QaImage(name=name, verdict="rejected", reasons=tuple(ReasonMessage.of(r) for r in reasons))


def _accepted_image(name: str, calibration: CArmCalibration) -> QaImage:
    middle = np.array([[0.5 * (calibration.width_px - 1), 0.5 * (calibration.height_px - 1)]])
    return QaImage(
        name=name,
        verdict="accepted",
        balls_found=calibration.balls_found,
        source_mm=vector3(calibration.camera_from_ring.inverse().translation_mm),
        source_deviation_mm=vector3(np.sqrt(np.diag(calibration.source_covariance_mm2))),
        mirrored=calibration.mirrored,
        reprojection_rms_px=calibration.reprojection_rms_px,
        distortion_residual_px=calibration.distortion_residual_px,
        central_deviation_px=float(calibration.distortion.standard_deviation_at(middle)[0]),
    )


def report_of(examined: Examined, ring: RingPart, before: QaReport | None, made_at: datetime) -> QaReport:
    """Put the report together; `before` is the last one of the same ring, or None."""
    residuals = [m.residuals for m in examined.measured]
    sources = np.array([m.image.source_mm for m in examined.measured])
    report = QaReport(
        made_at=made_at.isoformat(timespec="seconds"),
        software_version=software_version(),
        ring_sha256=ring.sha256,
        verdict="good",
        findings=(),
        images=examined.images,
        balls=tuple(_ball_row(name, k, residuals) for k, name in enumerate(ring.balls.ids)),
        mean_source_mm=vector3(sources.mean(axis=0)) if len(sources) else None,
        distortion_px=mean_distortion(residuals),
        drift=None,
    )
    drift = None if before is None else drift_between(report, before)
    found = findings(report.images, report.balls, drift)
    verdict = "attention" if found else "good"
    return report.model_copy(update={"drift": drift, "findings": found, "verdict": verdict})


def _ball_row(name: str, ball: int, residuals: Sequence[Residuals]) -> QaBall:
    found = ball_statistics(residuals, ball)
    return QaBall(
        id=name,
        seen=found.seen,
        shift_x_mm=found.shift_mm[0],
        shift_y_mm=found.shift_mm[1],
        rms_mm=found.rms_mm,
        sigmas=found.sigmas,
        flagged=found.moved or found.rarely_seen,
    )


def drift_between(now: QaReport, before: QaReport) -> QaDrift | None:
    """Changes since an earlier report of the same ring; None when one of them has no accepted image, or other balls."""
    if now.mean_source_mm is None or before.mean_source_mm is None or not _comparable(now, before):
        return None
    source = np.array(now.mean_source_mm) - np.array(before.mean_source_mm)
    change = np.array(now.distortion_px) - np.array(before.distortion_px)
    shifts = {b.id: np.hypot(*_shift(b, o)) for b, o in zip(now.balls, before.balls, strict=True) if b.seen and o.seen}
    worst = max(shifts, key=lambda name: float(shifts[name]), default="")
    return QaDrift(
        since=before.made_at,
        source_mm=vector3(source),
        distortion_rms_px=float(np.sqrt(np.mean(np.square(change)))),
        worst_ball=worst,
        worst_ball_mm=float(shifts.get(worst, 0.0)),
    )


def _comparable(now: QaReport, before: QaReport) -> bool:
    """A file that a person edited, or an older version wrote, may have other balls or places."""
    same_balls = [ball.id for ball in now.balls] == [ball.id for ball in before.balls]
    return same_balls and len(now.distortion_px) == len(before.distortion_px)


def _shift(ball: QaBall, other: QaBall) -> tuple[float, float]:
    return ball.shift_x_mm - other.shift_x_mm, ball.shift_y_mm - other.shift_y_mm


def findings(images: Sequence[QaImage], balls: Sequence[QaBall], drift: QaDrift | None) -> tuple[str, ...]:
    """Findings, each with what was measured, the limit and the remedy."""
    found = [f"{i.name} was refused: {i.reasons[0].message}" for i in images if i.verdict == "rejected" and i.reasons]
    limits = QUALITY_CONTROL
    accepted = sum(i.verdict == "accepted" for i in images)
    for ball in balls:
        if not ball.flagged:
            continue
        if ball.seen < QUALITY_CONTROL.least_seen * accepted:
            found.append(
                f"ball {ball.id} was seen in {ball.seen} of {accepted} images (at least {limits.least_seen:.0%}); "
                "check whether it is lost or always covered"
            )
        else:
            found.append(
                f"ball {ball.id} is {np.hypot(ball.shift_x_mm, ball.shift_y_mm):.3f} mm from where the ring's file "
                f"puts it (limit {limits.shift_mm:g} mm, {ball.sigmas:.0f} standard errors); "
                "measure or replace the ring"
            )
    return (*found, *_drift_findings(drift))


def _drift_findings(drift: QaDrift | None) -> tuple[str, ...]:
    if drift is None:
        return ()
    found = []
    across = float(np.hypot(*drift.source_mm[:2]))
    if across > QUALITY_CONTROL.source_drift_mm:
        found.append(
            f"the focal spot moved {across:.1f} mm across since {drift.since} (limit "
            f"{QUALITY_CONTROL.source_drift_mm:g} mm at the same angle of the C-arm); "
            "the ring may have been mounted anew, else have the C-arm serviced"
        )
    if drift.distortion_rms_px > QUALITY_CONTROL.distortion_drift_px:
        found.append(
            f"the distortion changed by {drift.distortion_rms_px:.2f} px rms since {drift.since} (limit "
            f"{QUALITY_CONTROL.distortion_drift_px:g} px); was the C-arm at the same angle?"
        )
    if drift.worst_ball_mm > QUALITY_CONTROL.worst_ball_mm:
        found.append(
            f"ball {drift.worst_ball} moved {drift.worst_ball_mm:.3f} mm since {drift.since} (limit "
            f"{QUALITY_CONTROL.worst_ball_mm:g} mm); check the ring"
        )
    return tuple(found)

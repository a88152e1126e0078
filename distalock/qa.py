"""`distalock qa`: the C-arm and the ring over a folder of images, as JSON and as a page with pictures."""

import argparse
import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from distalock.arguments import EXIT_BAD_INPUT
from distalock.locate import NominalOptions
from distalock.qa_measure import (
    LEAST_IMAGES,
    Measured,
    QaImage,
    QaReport,
    ball_table,
    drift_between,
    findings,
    image_files,
    mean_distortion,
    measured_image,
    rejected_image,
)
from distalock.qa_page import html_page
from services.imaging.core.calibration import calibrate_image
from services.imaging.devices.image_file import read_image
from shared.errors import Accepted, ImageUnreadable, InputError, Reason, ReasonCode
from shared.geometry.parts import RingPart
from shared.parts.files import read_part_file, ring_from_json
from shared.runtime.lifecycle import software_version

EXIT_GOOD, EXIT_ATTENTION = 0, 3
REPORT_FILE: Final = "qa.json"
PAGE_FILE: Final = "qa.html"
BEFORE_FILE: Final = "qa-before.json"


@dataclass(frozen=True, slots=True, eq=False)
class Examined:
    """All images of a folder; those that were accepted with their grey values."""

    images: tuple[QaImage, ...]
    measured: tuple[Measured, ...]
    pixels: tuple[NDArray[np.float32], ...]


def examine(folder: Path, ring: RingPart, nominal: NominalOptions) -> Examined:
    """Calibrate every image of a folder.

    Raises
    ------
    InputError
        When the folder holds no image.
    """
    if not folder.is_dir() or not (files := image_files(folder)):
        raise InputError(f"{folder}: 0 images (at least 1, PNG, TIFF or DICOM); name the folder of the ring's images")
    images: list[QaImage] = []
    measured: list[Measured] = []
    pixels: list[NDArray[np.float32]] = []
    for file in files:
        try:
            received = read_image(file.read_bytes(), file.name)
        except ImageUnreadable as error:
            images.append(rejected_image(file.name, (Reason(ReasonCode.IMAGE_UNUSABLE, str(error)),)))
            continue
        outcome = calibrate_image(received.pixels, ring, nominal.geometry(received.acquisition))
        if isinstance(outcome, Accepted):
            one = measured_image(file.name, outcome.value, ring, received.pixels)
            measured.append(one)
            pixels.append(received.pixels)
            images.append(one.image)
        else:
            images.append(rejected_image(file.name, outcome.reasons))
    return Examined(tuple(images), tuple(measured), tuple(pixels))


def report_of(examined: Examined, ring: RingPart, before: QaReport | None, made_at: datetime) -> QaReport:
    """Put the report together; `before` is the last one of the same ring, or None."""
    sources = np.array([m.image.source_mm for m in examined.measured])
    mean = sources.mean(axis=0) if len(sources) else None
    report = QaReport(
        made_at=made_at.isoformat(timespec="seconds"),
        software_version=software_version(),
        ring_sha256=ring.sha256,
        verdict="good",
        findings=(),
        images=examined.images,
        balls=ball_table(examined.measured, ring),
        mean_source_mm=None if mean is None else (float(mean[0]), float(mean[1]), float(mean[2])),
        distortion_px=mean_distortion(examined.measured),
        drift=None,
    )
    drift = None if before is None else drift_between(report, before)
    found = findings(report.images, report.balls, drift)
    verdict = "attention" if found else "good"
    return report.model_copy(update={"drift": drift, "findings": found, "verdict": verdict})


def earlier_report(file: Path, ring: RingPart) -> QaReport | None:
    """The last report, when there is one of the same ring.

    Raises
    ------
    InputError
        When the file is not such a report.
    """
    if not file.is_file():
        return None
    try:
        report = QaReport.model_validate_json(file.read_bytes())
    except (OSError, ValidationError) as error:
        first = str(error).splitlines()[0]
        raise InputError(f"{file}: no quality report ({first}); move it away or name another with --before") from None
    return report if report.ring_sha256 == ring.sha256 else None


def run(given: argparse.Namespace) -> int:
    """Run `distalock qa`; returns the exit code: 0 good, 3 something to look at, 2 bad input."""
    try:
        ring = ring_from_json(read_part_file(given.ring), str(given.ring))
        out = given.out or given.folder / "qa"
        before = earlier_report(given.before or out / REPORT_FILE, ring)
        nominal = NominalOptions(given.source_to_detector_mm, given.pixel_mm)
        examined = examine(given.folder, ring, nominal)
        report = report_of(examined, ring, before, datetime.now(UTC))
        _write(out, report, html_page(report, examined.measured, examined.pixels, ring))
    except InputError as error:
        print(f"distalock qa: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    _print(report, out)
    return EXIT_GOOD if report.verdict == "good" else EXIT_ATTENTION


def _write(out: Path, report: QaReport, page: str) -> None:
    """Write both files; the report that was there before is kept beside them."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        if (out / REPORT_FILE).is_file():
            (out / REPORT_FILE).replace(out / BEFORE_FILE)
        for name, content in ((REPORT_FILE, report.model_dump_json(by_alias=True, indent=1) + "\n"), (PAGE_FILE, page)):
            unfinished = out / f"{name}.part"
            unfinished.write_text(content, encoding="utf-8")
            unfinished.replace(out / name)
    except OSError as error:
        raise InputError(f"{out}: the report cannot be written: {error.strerror or error}") from None


def _print(report: QaReport, out: Path) -> None:
    accepted = [i for i in report.images if i.verdict == "accepted"]
    print(f"{report.verdict}: {len(accepted)} of {len(report.images)} images accepted; {out / PAGE_FILE}")
    for finding in report.findings:
        print(f"- {finding}")
    if len(accepted) < LEAST_IMAGES:
        print(f"- {len(accepted)} images tell nothing of single balls (at least {LEAST_IMAGES}); take more")

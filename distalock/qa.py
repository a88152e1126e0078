"""`distalock qa`: the C-arm and the ring over a folder of images, as JSON and as a page with pictures."""

import argparse
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from distalock.arguments import EXIT_BAD_INPUT
from distalock.image_files import images_in, read_image_file
from distalock.locate import NominalOptions
from distalock.outputs import require_writable, write_whole
from services.imaging.core.tuning import QUALITY_CONTROL
from services.imaging.service.quality_page import html_page
from services.imaging.service.quality_report import Shot, examine, rejected_image, report_of
from shared.errors import ImageUnreadable, InputError, Reason, ReasonCode
from shared.geometry.parts import RingPart
from shared.messages.qa import QaImage, QaReport
from shared.parts.files import read_part_file, ring_from_json

EXIT_GOOD, EXIT_ATTENTION = 0, 3
REPORT_FILE: Final = "qa.json"
PAGE_FILE: Final = "qa.html"
BEFORE_FILE: Final = "qa-before.json"


def image_files(folder: Path) -> list[Path]:
    """The images of a folder by name; raises `InputError` when it is no folder, or holds none."""
    if not folder.is_dir() or not (files := images_in(folder)):
        raise InputError(f"{folder}: 0 images (at least 1, PNG, TIFF or DICOM); name the folder of the ring's images")
    return files


def shots_of(files: list[Path], nominal: NominalOptions) -> Iterator[Shot | QaImage]:
    """What can be examined of image files; those that cannot be read as what the report says of them."""
    seen: dict[str, str] = {}
    for file in files:
        try:
            image = read_image_file(file, file.name)
        except ImageUnreadable as error:
            yield rejected_image(file.name, (Reason(ReasonCode.IMAGE_UNUSABLE, str(error)),))
            continue
        same = seen.setdefault(image.sha256, file.name)
        if same != file.name:
            message = f"the file is the same as {same}, and the same image says nothing twice; take it away"
            yield rejected_image(file.name, (Reason(ReasonCode.IMAGE_UNUSABLE, message),))
            continue
        try:
            geometry = nominal.geometry(image.content.acquisition)
        except ImageUnreadable as error:
            yield rejected_image(file.name, (Reason(ReasonCode.IMAGE_UNUSABLE, f"{file.name}: {error}"),))
            continue
        yield Shot(file.name, nominal.pixels(image.content.pixels), geometry)


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
        raise InputError(
            f"{file}: no quality report ({_first_fault(error)}); move it away or name another with --before"
        ) from None
    return report if report.ring_sha256 == ring.sha256 else None


def _first_fault(error: OSError | ValidationError) -> str:
    if isinstance(error, OSError):
        return error.strerror or str(error)
    first = error.errors()[0]
    return f"{'.'.join(str(part) for part in first['loc']) or 'file'}: {first['msg']}"


def named_report(file: Path, ring: RingPart) -> QaReport:
    """The report that was named; raises `InputError` when it is none, or of another ring."""
    report = earlier_report(file, ring)
    if report is None:
        raise InputError(f"{file}: the report is of another ring than the one given; name one of this ring")
    return report


def run(given: argparse.Namespace) -> int:
    """Run `distalock qa`; returns the exit code: 0 good, 3 something to look at, 2 bad input."""
    try:
        ring = ring_from_json(read_part_file(given.ring), str(given.ring))
        files = image_files(given.folder)
        out = given.out or given.folder / "qa"
        before = earlier_report(out / REPORT_FILE, ring) if given.before is None else named_report(given.before, ring)
        nominal = NominalOptions.of(given)
        _make(out)
        examined = examine(shots_of(files, nominal), ring)
        report = report_of(examined, ring, before, datetime.now(UTC))
        _write(out, report, html_page(report, examined.measured, ring))
    except InputError as error:
        print(f"distalock qa: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    _print(report, out)
    return EXIT_GOOD if report.verdict == "good" else EXIT_ATTENTION


def _make(out: Path) -> None:
    """The report's folder, before the work; raises `InputError` when nothing can be written there."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"{out}: the report cannot be written there: {why}; name another folder with --out") from None
    require_writable(out / REPORT_FILE)


def _write(out: Path, report: QaReport, page: str) -> None:
    """Write both files; the report that was there before is kept beside them."""
    if (out / REPORT_FILE).is_file():
        write_whole(out / BEFORE_FILE, (out / REPORT_FILE).read_bytes())
    write_whole(out / REPORT_FILE, (report.model_dump_json(by_alias=True, indent=1) + "\n").encode())
    write_whole(out / PAGE_FILE, page.encode())


def _print(report: QaReport, out: Path) -> None:
    accepted = [i for i in report.images if i.verdict == "accepted"]
    print(f"{report.verdict}: {len(accepted)} of {len(report.images)} images accepted; {out / PAGE_FILE}")
    for finding in report.findings:
        print(f"- {finding}")
    if len(accepted) < QUALITY_CONTROL.least_images:
        needed = QUALITY_CONTROL.least_images
        print(f"- {len(accepted)} images are too few to report single balls (at least {needed}); take more")

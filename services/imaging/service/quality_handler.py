"""Quality reports over images that are kept here, and the last report of each ring to compare with."""

from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path

from pydantic import ValidationError

from services.imaging.core.nominal import NominalGeometry
from services.imaging.devices.image_file import read_image
from services.imaging.devices.image_store import ImageStore, write_atomically
from services.imaging.service.headers import polarity_of
from services.imaging.service.quality_page import html_page
from services.imaging.service.quality_report import Shot, examine, report_of
from shared.geometry.parts import RingPart
from shared.messages.base import decode, encode
from shared.messages.imaging import FrameHeader
from shared.messages.qa import QaReply, QaReport, QaRequest

# Enough hexadecimal digits of a hash to tell images apart by eye.
_SHOWN_DIGITS = 12


class QualityHandler:
    """Makes reports.

    Parameters
    ----------
    store
        Where the images are.
    folder
        Where the last report of each ring is kept.
    now
        The time, with its zone.
    """

    def __init__(self, store: ImageStore, folder: Path, now: Callable[[], datetime]) -> None:
        self._store, self._folder, self._now = store, folder, now

    def reply(self, request: QaRequest, ring: RingPart | None) -> QaReply:
        """A report over the images; `ring` is that of the request's case, None when that is not open or has none."""
        if ring is None:
            message = f"case '{request.case_id}' is not open here, or has no ring; open a case with the ring's file"
            return QaReply(code="case_not_open", message=message)
        missing = [s for s in request.image_sha256 if self._store.get_header(s) is None or self._store.get(s) is None]
        if missing:
            message = (
                f"{len(missing)} of the {len(request.image_sha256)} images are not kept here (limit 0), the first "
                f"{missing[0][:_SHOWN_DIGITS]}; send them again"
            )
            return QaReply(code="unknown_image", message=message)
        examined = examine(self._shots(request.image_sha256), ring)
        report = report_of(examined, ring, self._last(ring), self._now())
        if examined.measured:
            self._folder.mkdir(parents=True, exist_ok=True)
            write_atomically(self._file(ring), encode(report))
        return QaReply(report=report, page=html_page(report, examined.measured, ring))

    def _shots(self, image_sha256: tuple[str, ...]) -> Iterator[Shot]:
        for sha256 in image_sha256:
            content, header_json = self._store.get(sha256), self._store.get_header(sha256)
            assert content is not None, "asked before"
            assert header_json is not None, "asked before"
            header = decode(FrameHeader, header_json)
            nominal = NominalGeometry(
                header.nominal_source_to_detector_mm, header.nominal_pixel_mm, header.focal_spot_mm
            )
            yield Shot(
                sha256[:_SHOWN_DIGITS], polarity_of(header).normalised(read_image(content, sha256).pixels), nominal
            )

    def _file(self, ring: RingPart) -> Path:
        return self._folder / f"{ring.sha256}.json"

    def _last(self, ring: RingPart) -> QaReport | None:
        """The last report of this ring; one that an older version wrote otherwise is none."""
        try:
            return QaReport.model_validate_json(self._file(ring).read_bytes())
        except (FileNotFoundError, ValidationError):
            return None

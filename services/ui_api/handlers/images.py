"""Images for people: pixels fetched by hash from imaging, drawn as PNG; the stored DICOM from the image folder."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import ImageReceived
from services.ui_api.core.picture import grey_8_bits, png_of
from services.ui_api.handlers.refusals import RefusalKind, Refused, conflict, unknown
from services.ui_api.record.images import stored_image
from services.ui_api.record.record import CaseRecord
from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.errors import NoReply
from shared.messages.base import decode
from shared.messages.imaging import CalibrationMessage, FrameHeader

FRAME_TIMEOUT_S = 2.0


@dataclass(frozen=True, slots=True)
class KnownImage:
    """An image and the case that it belongs to."""

    image: ImageReceived
    case: Case


class ImageHandler:
    """Finds images in the record and fetches what the record does not hold.

    Parameters
    ----------
    image_dir
        Folder in which imaging stores the files it received, each under its SHA-256.
    """

    def __init__(self, bus: Bus, keys: Keys, record: CaseRecord, image_dir: Path) -> None:
        self._bus, self._keys, self._record = bus, keys, record
        self._image_dir = image_dir

    def find(self, sha256: str) -> KnownImage:
        """An image of any case, the newest case first; raises `Refused`."""
        for case in reversed(self._record.ledger.cases.values()):
            image = case.image(sha256)
            if image is None and case.frames_let_go:
                image = self._record.image_let_go(case.case_id, sha256)
            if image is not None:
                return KnownImage(image, case)
        raise unknown("image", sha256, "GET /cases/{id}/images lists those of a case")

    def header(self, image: ImageReceived) -> FrameHeader | None:
        """The image's header, if it came in."""
        if image.header_sha256 is None:
            return None
        return decode(FrameHeader, self._record.document(image.header_sha256))

    def dicom(self, sha256: str) -> bytes:
        """The file exactly as imaging stored it; raises `Refused`."""
        self.find(sha256)
        file = stored_image(self._image_dir, sha256)
        if file is not None:
            return file.read_bytes()
        raise Refused(
            RefusalKind.UNAVAILABLE,
            "image_file_unreachable",
            f"the file of image {sha256[:12]} is not in {self._image_dir}: it was removed by rule, which an event "
            "images_pruned then says, or image_dir is not the folder in which imaging stores its files",
        )

    def basis(self, sha256: str, view: str) -> str:
        """Hash of what a view is drawn with beside the pixels; empty without any. Raises `Refused`."""
        case = self.find(sha256).case
        calibrated, measured = case.calibration_of(sha256), case.localisation_of(sha256)
        if view == "corrected":
            return "" if calibrated is None else calibrated.document_sha256
        return "" if view == "raw" or measured is None else measured.overlay_sha256 or ""

    def raw_png(self, sha256: str) -> bytes:
        """The image as received, with its grey values stretched to 8 bits."""
        self.find(sha256)
        return png_of(grey_8_bits(self._pixels(sha256)))

    def corrected_png(self, sha256: str) -> bytes:
        """The image without distortion, un-mirrored when the calibration says that it is mirrored. For people only."""
        known = self.find(sha256)
        calibrated = known.case.calibration_of(sha256)
        message = None
        if calibrated is not None:
            message = decode(CalibrationMessage, self._record.document(calibrated.document_sha256))
        if message is None or message.values is None:
            raise conflict("image_not_calibrated", f"image {sha256[:12]} has no calibration, so it cannot be corrected")
        calibration = message.values.calibration()
        pixels = self._pixels(sha256)
        if calibration.mirrored:
            pixels = pixels[:, ::-1]
        rows, columns = np.mgrid[0 : calibration.height_px, 0 : calibration.width_px].astype(np.float64)
        measured = calibration.distortion.distort(np.stack([columns, rows], axis=-1))
        places = (measured[..., 1], measured[..., 0])
        shown = map_coordinates(grey_8_bits(pixels), places, order=1, mode="grid-constant", cval=0)
        return png_of(np.asarray(shown, dtype=np.uint8))

    def overlay_png(self, sha256: str) -> bytes:
        """What registration found, drawn on the image."""
        measured = self.find(sha256).case.localisation_of(sha256)
        if measured is None or measured.overlay_sha256 is None:
            raise conflict("no_overlay", f"image {sha256[:12]} has no localisation with an overlay (yet)")
        return self._record.document(measured.overlay_sha256)

    def _pixels(self, sha256: str) -> NDArray[np.float32]:
        try:
            answer = self._bus.query(self._keys.frame_by_hash(sha256), b"", FRAME_TIMEOUT_S)
        except NoReply as error:
            raise Refused(
                RefusalKind.UNAVAILABLE,
                "pixels_unreachable",
                f"imaging did not hand out the pixels of image {sha256[:12]}: {error}; check that imaging runs",
            ) from None
        return decode(FrameHeader, answer.attachment).pixels(answer.payload)

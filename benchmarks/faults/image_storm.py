"""Another C-arm: images by DICOM C-STORE, as fast as is wanted, and which of them were acknowledged."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from typing import Final

from pydicom import Dataset, dcmread
from pydicom.uid import generate_uid
from pynetdicom import AE
from pynetdicom.association import Association

from benchmarks.faults.site import FaultSite
from shared.threads import supervised_thread

_TITLE: Final = "STORM"
_SUCCESS: Final = 0x0000
_SECONDS: Final = 10.0


@dataclass(frozen=True, slots=True)
class ImageSender:
    """Sends the room's last image again and again, each time as a new one."""

    site: FaultSite
    images_per_s: float

    @contextmanager
    def sending(self) -> Iterator[None]:
        """Send from a thread until the context ends."""
        template, ended = self._template(), threading.Event()

        def send() -> None:
            association = self._associated(template)
            begun_s, count = time.monotonic(), 0
            while not ended.wait(max(begun_s + count / self.images_per_s - time.monotonic(), 0.0)):
                count += 1
                self._send(association, template)
            association.release()

        thread = supervised_thread("image storm", send)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def _template(self) -> Dataset:
        """The room's last image; one is taken when there is none."""
        room = self.site.room
        if room.control.get("/truth")["last_image"] is None:
            room.room.take_shot()
        return dcmread(BytesIO(room.control.get_bytes("/shots/last.dcm")))

    def _associated(self, template: Dataset) -> Association:
        entity = AE(ae_title=_TITLE)
        entity.add_requested_context(template.SOPClassUID, template.file_meta.TransferSyntaxUID)
        entity.connection_timeout = entity.acse_timeout = entity.dimse_timeout = entity.network_timeout = _SECONDS
        return entity.associate("127.0.0.1", self.site.room.installation.ports.dicom, ae_title="DISTALOCK")

    def _send(self, association: Association, image: Dataset) -> None:
        uid = generate_uid()
        image.SOPInstanceUID = image.file_meta.MediaStorageSOPInstanceUID = uid
        if association.is_established and association.send_c_store(image).get("Status") == _SUCCESS:
            self.site.acknowledged.images.append(str(uid))

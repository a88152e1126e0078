"""Every source of images keeps the same promises, whatever the images come from."""

import queue
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
import pytest
import structlog
from numpy.typing import NDArray
from pydicom.uid import ExplicitVRLittleEndian, RLELossless, SecondaryCaptureImageStorage
from pynetdicom import AE

from distalock.local_ports import free_ports
from services.imaging.devices.dicom_receiver import DicomSource, Endpoint
from services.imaging.devices.folder_source import FolderSource
from services.imaging.devices.image_file import read_image
from services.imaging.devices.source import ImageSource, Refused
from services.imaging.devices.video_source import VideoSettings, VideoSource
from shared.errors import ImageUnreadable
from tests.unit.services.imaging.devices.dicom_samples import dataset_of

PATIENCE_S = 60.0
LOG: structlog.stdlib.BoundLogger = structlog.stdlib.get_logger("sources")
Picture = NDArray[np.uint16]


def picture(number: int) -> Picture:
    """A grey slope with a dark square whose place tells the pictures apart."""
    y, x = np.mgrid[:128, :160]
    pixels = 20000.0 + 100.0 * x + 50.0 * y
    pixels[40:80, 20 * number : 20 * number + 20] = 6000.0
    return np.asarray(pixels, dtype=np.uint16)


def number_of(content: bytes) -> int:
    """Which picture an image shows."""
    pixels = read_image(content, "taken").pixels
    row = pixels[60] / pixels[20]
    return int(np.argmin(row)) // 20


class Taker:
    """Takes images; refuses the first as told, once."""

    def __init__(self, refusal: Exception | None = None) -> None:
        self.taken: queue.Queue[tuple[bytes, str]] = queue.Queue()
        self.refused = threading.Event()
        self._refusal = refusal

    def __call__(self, content: bytes, sender: str, _waited_s: float | None = 0.0, /) -> None:
        if self._refusal is not None:
            refusal, self._refusal = self._refusal, None
            self.refused.set()
            raise refusal
        self.taken.put((content, sender))

    def next(self) -> tuple[bytes, str]:
        return self.taken.get(timeout=PATIENCE_S)


class Rig(Protocol):
    """A source, and the other side of it."""

    source: ImageSource

    def show(self, number: int) -> None:
        """Make the picture arrive."""
        ...


class DicomRig:
    """A C-arm that sends compressed and plain objects in turn."""

    def __init__(self) -> None:
        (self._port,) = free_ports(1)
        self.source: ImageSource = DicomSource(Endpoint("127.0.0.1", self._port, "DISTALOCK"), LOG)

    def show(self, number: int) -> None:
        dataset = dataset_of(picture(number))
        syntax = ExplicitVRLittleEndian
        if number % 2:
            dataset.compress(RLELossless, generate_instance_uid=False)
            syntax = RLELossless
        entity = AE(ae_title="CARM")
        entity.add_requested_context(SecondaryCaptureImageStorage, syntax)
        association = entity.associate("127.0.0.1", self._port, ae_title="DISTALOCK")
        assert association.is_established
        association.send_c_store(dataset)
        association.release()


class FolderRig:
    """Someone who copies files into the folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "incoming"
        self.source: ImageSource = FolderSource(self._folder, LOG)

    def show(self, number: int) -> None:
        (self._folder / f"shot{number}.png").write_bytes(cv2.imencode(".png", picture(number))[1].tobytes())


class StreamRig:
    """A video stream over TCP: the picture shown last, again and again, with noise."""

    def __init__(self) -> None:
        self._number = 0
        self._ended = threading.Event()
        self._server = socket.create_server(("127.0.0.1", 0))
        port = self._server.getsockname()[1]
        settings = VideoSettings(f"tcp://127.0.0.1:{port}", least_frames=3, most_frames=5)
        self.source: ImageSource = VideoSource(settings, LOG)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def show(self, number: int) -> None:
        self._number = number

    def close(self) -> None:
        self._ended.set()
        self._thread.join(PATIENCE_S)
        self._server.close()

    def _serve(self) -> None:
        rng = np.random.default_rng(5)
        self._server.settimeout(0.2)
        while not self._ended.is_set():
            try:
                client, _ = self._server.accept()
            except TimeoutError:
                continue
            with client:
                self._feed(client, rng)

    def _feed(self, client: socket.socket, rng: np.random.Generator) -> None:
        while not self._ended.wait(0.02):
            frame = picture(self._number) / 256.0 if self._number else np.full((128, 160), 90.0)
            noisy = np.clip(frame + rng.normal(0.0, 2.0, frame.shape), 0.0, 255.0).astype(np.uint8)
            try:
                client.sendall(cv2.imencode(".jpg", noisy, (cv2.IMWRITE_JPEG_QUALITY, 95))[1].tobytes())
            except OSError:
                return


@contextmanager
def rig_of(kind: str, folder: Path) -> Iterator[Rig]:
    if kind == "stream":
        rig = StreamRig()
        rig.show(1)
        try:
            yield rig
        finally:
            rig.close()
    else:
        yield DicomRig() if kind == "dicom" else FolderRig(folder)


@pytest.fixture(params=["dicom", "folder", "stream"])
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
    with rig_of(str(request.param), tmp_path) as built:
        yield built


def test_images_arrive_in_order_with_the_senders_name(rig: Rig) -> None:
    taker = Taker()
    with rig.source.receiving(taker) as place:
        assert place
        for number in (1, 4, 2):
            rig.show(number)
            content, sender = taker.next()
            assert number_of(content) == number
            assert sender


@pytest.mark.parametrize("refusal", [ImageUnreadable("no image"), Refused("busy"), OSError("disk full")])
def test_after_a_refusal_the_next_image_arrives(rig: Rig, refusal: Exception) -> None:
    taker = Taker(refusal)
    with rig.source.receiving(taker):
        rig.show(1)
        assert taker.refused.wait(PATIENCE_S)
        rig.show(3)
        while number_of(taker.next()[0]) != 3:  # a source may offer a postponed image again
            pass


def test_nothing_arrives_after_the_end_and_it_can_be_opened_again(rig: Rig) -> None:
    taker, again = Taker(), Taker()
    with rig.source.receiving(taker):
        rig.show(1)
        taker.next()
    with rig.source.receiving(again):
        rig.show(2)
        while number_of(again.next()[0]) != 2:
            pass
    assert taker.taken.empty()

import queue
import shutil
import subprocess
import threading
import time
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
import structlog
from numpy.typing import NDArray

from distalock.local_ports import free_ports
from services.imaging.devices.image_file import read_image
from services.imaging.devices.video_images import Region
from services.imaging.devices.video_source import VideoSettings, VideoSource, device_of
from shared.errors import ConfigurationError
from tests.unit.services.imaging.devices.fake_video import FakeCamera
from tests.unit.services.imaging.synthetic import shade

LOG: structlog.stdlib.BoundLogger = structlog.stdlib.get_logger("video")
PATIENCE_S = 60.0


def view(shift_px: float) -> NDArray[np.float64]:
    light = np.ones((240, 320))
    for x in range(40, 300, 40):
        for y in range(30, 230, 40):
            shade(light, x + shift_px, y, 6.0)
    return 200.0 * light


def noisy(shift_px: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    return np.clip(view(shift_px) + rng.normal(0.0, 6.0, (240, 320)), 0, 255).astype(np.uint8)


def film(file: Path, shifts: list[float]) -> Path:
    """A Motion JPEG of noisy views."""
    rng = np.random.default_rng(3)
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (320, 240), isColor=False)
    assert writer.isOpened()
    for shift in shifts:
        writer.write(noisy(shift, rng))
    writer.release()
    return file


def images_of(settings: VideoSettings, count: int) -> list[NDArray[np.float32]]:
    taken: queue.Queue[bytes] = queue.Queue()
    with VideoSource(settings, LOG).receiving(lambda content, *_: taken.put(content)):
        return [read_image(taken.get(timeout=PATIENCE_S), "video").pixels for _ in range(count)]


def test_one_averaged_image_comes_of_each_view(tmp_path: Path) -> None:
    file = film(tmp_path / "film.avi", [0.0] * 12 + [3.0, 6.0, 9.0] + [12.0] * 10)
    first, second = images_of(VideoSettings(str(file), most_frames=8), 2)
    truth = view(0.0)
    noise = np.std(257.0 * truth[:15] - first[:15])
    assert noise < 0.6 * 257.0 * 6.0
    assert np.corrcoef(first.ravel(), truth.ravel())[0, 1] > 0.98
    assert np.corrcoef(second.ravel(), view(12.0).ravel())[0, 1] > 0.98


def test_every_view_of_a_file_becomes_an_image(tmp_path: Path) -> None:
    file = film(tmp_path / "film.avi", [*[0.0] * 3, *[6.0] * 3, *[12.0] * 3, *[18.0] * 3])
    images = images_of(VideoSettings(str(file), most_frames=3), 4)
    for shift, image in zip((0.0, 6.0, 12.0, 18.0), images, strict=True):
        assert np.corrcoef(image.ravel(), view(shift).ravel())[0, 1] > 0.98


def test_views_that_have_gone_while_an_image_was_taken_are_not_handed_on() -> None:
    """A live source does not wait; what it showed in the meantime would be taken for what is there now."""
    camera, rng = FakeCamera(), np.random.default_rng(9)
    taking, go = threading.Event(), threading.Event()
    taken: queue.Queue[bytes] = queue.Queue()
    waited_s: list[float | None] = []

    def take(content: bytes, _: str, waited: float | None = 0.0, /) -> None:
        taken.put(content)
        waited_s.append(waited)
        taking.set()
        assert go.wait(PATIENCE_S)

    settings = VideoSettings("tcp://camera", most_frames=3)
    with VideoSource(settings, LOG, opened=lambda _: camera).receiving(take):
        try:
            while not taking.is_set():
                camera.show(lambda: noisy(0.0, rng))
            camera.show(lambda: noisy(6.0, rng), 20)
            camera.show(lambda: noisy(12.0, rng), 5)
            taking.clear()
            go.set()
            while not taking.is_set():
                camera.show(lambda: noisy(12.0, rng))
        finally:
            go.set()
            camera.unplug()
    first, second = (read_image(taken.get(timeout=PATIENCE_S), "video").pixels for _ in range(2))
    assert np.corrcoef(first.ravel(), view(0.0).ravel())[0, 1] > 0.98
    assert np.corrcoef(second.ravel(), view(12.0).ravel())[0, 1] > 0.98
    assert all(waited is not None and 0.0 < waited < PATIENCE_S for waited in waited_s), "since its frame was grabbed"


def test_the_region_is_cut_out_and_the_format_is_told(tmp_path: Path) -> None:
    file = film(tmp_path / "film.avi", [0.0] * 6)
    settings = VideoSettings(str(file), Region(20, 10, 200, 100), most_frames=4)
    with VideoSource(settings, LOG).receiving(lambda *_: None) as place:
        assert "320 x 240 MJPG, 25 frames/s, of which 200 x 100" in place
    assert images_of(settings, 1)[0].shape == (100, 200)


def test_a_video_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    source = VideoSource(VideoSettings(str(tmp_path / "none.avi")), LOG, tmp_path)
    with (
        pytest.raises(ConfigurationError, match=r"none.avi did not open within 5 s; check"),
        source.receiving(lambda *_: None),
    ):
        pass


def test_a_device_is_found_by_a_part_of_its_stable_name(tmp_path: Path) -> None:
    device = tmp_path / "video7"
    device.touch()
    (tmp_path / "usb-Epiphan_DVI2USB_123-video-index0").symlink_to(device)
    (tmp_path / "usb-Epiphan_DVI2USB_123-video-index1").symlink_to(device)
    assert device_of("DVI2USB_123", tmp_path) == str(device)
    assert device_of("rtsp://c-arm/stream", tmp_path) == "rtsp://c-arm/stream"
    (tmp_path / "usb-Epiphan_DVI2USB_999-video-index0").symlink_to(device)
    with pytest.raises(
        ConfigurationError, match=r"2 video devices fit 'DVI2USB' \(1 needed\): usb-Epiphan_DVI2USB_123"
    ):
        device_of("DVI2USB", tmp_path)


def first_image_of(settings: VideoSettings, sender: subprocess.Popen[bytes]) -> NDArray[np.float32]:
    """Wait for an image; the sender takes one connection only, so that nobody may try beforehand if it is there."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            return images_of(settings, 1)[0]
        except ConfigurationError:
            if time.monotonic() > deadline:
                raise
            with suppress(subprocess.TimeoutExpired):
                sender.wait(0.2)
            assert sender.poll() is None, "ffmpeg ended"


FFMPEG = shutil.which("ffmpeg")


@pytest.mark.skipif(FFMPEG is None, reason="ffmpeg is not installed (apt-get install ffmpeg)")
@pytest.mark.parametrize("protocol", ["udp", "tcp"])
def test_a_stream_of_ffmpeg_is_received(tmp_path: Path, protocol: str) -> None:
    assert FFMPEG is not None
    file = film(tmp_path / "film.avi", [0.0] * 50)
    (port,) = free_ports(1)
    address = f"{protocol}://127.0.0.1:{port}"
    listen = ["-listen", "1"] if protocol == "tcp" else []
    with subprocess.Popen(
        [FFMPEG, "-loglevel", "error", "-stream_loop", "-1", "-re", "-i", str(file), "-f", "mpegts", *listen, address]
    ) as process:
        try:
            image = first_image_of(VideoSettings(address), process)
        finally:
            process.kill()
    assert np.corrcoef(image.ravel(), view(0.0).ravel())[0, 1] > 0.9

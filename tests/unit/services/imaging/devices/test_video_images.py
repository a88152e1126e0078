from collections.abc import Iterator

import numpy as np
import pytest
import structlog
from structlog.testing import capture_logs

from services.imaging.core.still_frames import MotionLimits
from services.imaging.devices.video_frames import Frame, GrabbedFrames
from services.imaging.devices.video_images import Region, VideoImage, VideoImages, cut, grey_of
from tests.unit.services.imaging.devices.test_video_source import noisy, view

LOG: structlog.stdlib.BoundLogger = structlog.stdlib.get_logger("video")
LIMITS = MotionLimits(least_frames=3, most_frames=8)


class Source:
    """Frames at times of a clock that stands still between them."""

    def __init__(self, *shown: tuple[float, float]) -> None:
        self._shown, self._rng = shown, np.random.default_rng(11)
        self.now_s = 0.0
        self.dropped = 0

    def frames(self) -> Iterator[Frame]:
        for now_s, shift_px in self._shown:
            self.now_s = now_s
            yield Frame(noisy(shift_px, self._rng), self.now_s)

    def images(self) -> list[VideoImage]:
        grabbed = GrabbedFrames(self.frames(), lambda: self.dropped)
        return list(VideoImages(grabbed, None, "C-arm", LOG, lambda: self.now_s).averaged(LIMITS))


def shift_of(image: VideoImage) -> float:
    return max((0.0, 12.0), key=lambda shift: float(np.corrcoef(image.mean.ravel(), view(shift).ravel())[0, 1]))


def test_an_image_is_as_old_as_the_newest_frame_that_was_averaged() -> None:
    """One of another view ends the run, perhaps long after, when a source has stalled: it is not of the image."""
    shown = [(0.0, 0.0), (0.1, 0.0), (0.2, 0.0), (5.0, 12.0), (5.1, 12.0), (5.2, 12.0)]
    images = Source(*shown).images()
    assert [(shift_of(image), image.grabbed_at_s) for image in images] == [(0.0, 0.2), (12.0, 5.2)]


def test_rate_dropped_frames_and_age_are_in_the_log_every_ten_seconds() -> None:
    source = Source(*[(4.0 * k, 0.0) for k in range(4)])
    grabbed = GrabbedFrames(source.frames(), lambda: round(5 * source.now_s))
    with capture_logs() as logs:
        list(VideoImages(grabbed, None, "C-arm", LOG, lambda: source.now_s).averaged(LIMITS))
    assert [{key: line[key] for key in ("frames_per_s", "dropped", "oldest_image_s")} for line in logs] == [
        {"frames_per_s": pytest.approx(64.0 / 12.0, abs=0.01), "dropped": 60, "oldest_image_s": 0.0}
    ]


def test_grey_and_colour_frames_become_grey() -> None:
    grey = np.arange(12, dtype=np.uint8).reshape(3, 4)
    assert (grey_of(grey) == grey).all()
    assert grey_of(np.repeat(grey[..., None], 3, axis=2)) == pytest.approx(grey, abs=0.01)


def test_a_region_beyond_the_frame_takes_what_is_there() -> None:
    frame = np.ones((20, 30), np.float32)
    assert cut(frame, Region(20, 10, 100, 100)).shape == (10, 10)
    assert cut(frame, Region(500, 500, 100, 100)).shape == (20, 30)

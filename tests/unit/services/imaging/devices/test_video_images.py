from collections.abc import Iterator

import numpy as np
import pytest
import structlog
from structlog.testing import capture_logs

from services.imaging.core.still_frames import MotionLimits, StillRun
from services.imaging.devices.video_frames import Frame, GrabbedFrames
from services.imaging.devices.video_images import Region, VideoImages, cut, grey_of
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

    def runs(self, oldest_s: float) -> list[StillRun]:
        grabbed = GrabbedFrames(self.frames(), lambda: self.dropped, oldest_s)
        return list(VideoImages(grabbed, None, "C-arm", LOG, lambda: self.now_s).runs(LIMITS))


def shift_of(run: StillRun) -> float:
    return max((0.0, 12.0), key=lambda shift: float(np.corrcoef(run.mean.ravel(), view(shift).ravel())[0, 1]))


STALLED = [(0.0, 0.0)] * 3 + [(5.0, 12.0)] * 4


def test_an_image_that_waited_too_long_is_not_handed_on_and_the_view_is_averaged_anew() -> None:
    """The robot may have moved while the source was silent: the image of before would be bound to its new place."""
    with capture_logs() as logs:
        runs = Source(*STALLED).runs(oldest_s=0.5)
    assert [shift_of(run) for run in runs] == [12.0]
    (late,) = [line for line in logs if line["event"] == "image too old"]
    assert "waited 5.00 s (limit 0.5 s); the view is averaged anew" in late["detail"]


def test_a_file_has_no_age() -> None:
    assert [shift_of(run) for run in Source(*STALLED).runs(oldest_s=float("inf"))] == [0.0, 12.0]


def test_the_age_is_that_of_the_newest_frame_that_was_averaged() -> None:
    """One of another view ended the run: it is not of the image."""
    shown = [(0.0, 0.0), (0.1, 0.0), (0.2, 0.0), (0.8, 12.0), (0.9, 12.0)]
    assert Source(*shown).runs(oldest_s=0.5) == []
    assert [shift_of(run) for run in Source(*shown).runs(oldest_s=0.7)] == [0.0]


def test_rate_dropped_frames_and_age_are_in_the_log_every_ten_seconds() -> None:
    source = Source(*[(4.0 * k, 0.0) for k in range(4)])
    grabbed = GrabbedFrames(source.frames(), lambda: round(5 * source.now_s), float("inf"))
    with capture_logs() as logs:
        list(VideoImages(grabbed, None, "C-arm", LOG, lambda: source.now_s).runs(LIMITS))
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

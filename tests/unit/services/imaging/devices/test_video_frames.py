import threading

import numpy as np

from services.imaging.devices.video_frames import every_frame, newest_frames
from tests.unit.services.imaging.devices.fake_video import FakeCamera, Picture


def grey(level: int) -> Picture:
    return np.full((4, 4), level, np.uint8)


def test_of_a_live_source_the_newest_frame_is_taken_and_the_others_are_counted() -> None:
    camera = FakeCamera()
    with newest_frames(camera, threading.Event()) as grabbed:
        camera.show(lambda: grey(1))
        assert next(grabbed.frames).picture[0, 0] == 1
        camera.show(lambda: grey(2), 9)
        camera.show(lambda: grey(3))
        assert next(grabbed.frames).picture[0, 0] == 3
        assert grabbed.dropped() == 9
        camera.unplug()
        assert list(grabbed.frames) == []


def test_nobody_reads_a_source_that_was_left() -> None:
    camera = FakeCamera()
    with newest_frames(camera, threading.Event()):
        camera.show(lambda: grey(1))
        camera.unplug()
    assert "video frames" not in {thread.name for thread in threading.enumerate()}


def test_every_frame_of_a_file_is_read_when_it_is_needed() -> None:
    frames = [grey(level) for level in range(9)]

    class Film(FakeCamera):
        def read(self) -> tuple[bool, Picture | None]:
            return (True, frames.pop(0)) if frames else (False, None)

    with every_frame(Film(), threading.Event()) as grabbed:
        next(grabbed.frames)
        assert len(frames) == 8
        assert [int(frame.picture[0, 0]) for frame in grabbed.frames] == [1, 2, 3, 4, 5, 6, 7, 8]
        assert grabbed.dropped() == 0


def test_reading_ends_when_the_source_is_to_end() -> None:
    ended = threading.Event()
    ended.set()
    with every_frame(FakeCamera(), ended) as grabbed:
        assert list(grabbed.frames) == []

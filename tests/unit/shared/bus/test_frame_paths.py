"""By which way frames came: the first by TCP is usual, more are a fallback."""

from shared.bus.frame_paths import FramePaths
from shared.bus.port import Sample

SHARED = Sample("frame", b"", b"", by_shared_memory=True)
TCP = Sample("frame", b"", b"")


def seen(*samples: Sample) -> FramePaths:
    paths = FramePaths()
    for sample in samples:
        paths.note(sample)
    return paths


def test_the_first_frame_may_come_by_tcp() -> None:
    paths = seen(TCP, SHARED, SHARED)
    assert not paths.fallen_back
    assert paths.sentence == "frames by shared memory 2, by TCP 1"


def test_frames_that_go_on_by_tcp_are_a_fallback_until_one_is_shared_again() -> None:
    assert seen(TCP, SHARED, TCP, TCP).fallen_back
    assert not seen(TCP, TCP, SHARED).fallen_back


def test_two_samples_are_the_same_by_whatever_way_they_came() -> None:
    assert TCP == SHARED

"""Each frame becomes a picture once, elsewhere, for all viewers; an encoder that fails costs pictures alone."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from services.ui_api.handlers.acting import Acting
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.live import LiveHandler
from services.ui_api.handlers.picture_encoder import EncoderFailed, PictureEncoder
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.messages.base import encode
from shared.messages.imaging import FrameHeader
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import wait_until

HEADER = samples.frame_header("one", None, 1, 1)


@pytest.fixture
def encoder() -> Iterator[PictureEncoder]:
    encoder = PictureEncoder(answers_within_s=PATIENCE_S)
    yield encoder
    encoder.close()


def test_an_encoder_that_was_killed_costs_one_picture(encoder: PictureEncoder) -> None:
    assert encoder.picture(HEADER, samples.pixels()).startswith(b"\xff\xd8")
    first = encoder.pid
    assert first is not None
    os.kill(first, signal.SIGKILL)
    with pytest.raises(EncoderFailed, match="started anew"):
        encoder.picture(HEADER, samples.pixels())
    assert encoder.picture(HEADER, samples.pixels()).startswith(b"\xff\xd8")
    assert encoder.pid not in (first, None)


def test_an_encoder_that_hangs_is_ended() -> None:
    hung = PictureEncoder((sys.executable, "-c", "import time; time.sleep(600)"), answers_within_s=0.2)
    began_s = time.monotonic()
    with pytest.raises(EncoderFailed, match="did not answer"):
        hung.picture(HEADER, samples.pixels())
    assert hung.pid is None
    assert time.monotonic() - began_s < PATIENCE_S


class CountingEncoder(PictureEncoder):
    """Notes which frames it is given; the first attempt may fail."""

    def __init__(self, *, fails_first: bool = False) -> None:
        super().__init__()
        self.encoded: list[str] = []
        self._fails = fails_first

    def picture(self, header: FrameHeader, payload: bytes) -> bytes:
        self.encoded.append(header.sha256)
        if self._fails:
            self._fails = False
            raise EncoderFailed("it died")
        return header.sha256.encode() + payload[:1]


class Watched:
    """A live handler on a bus of its own, with viewers."""

    def __init__(self, stack: ExitStack, encoder: PictureEncoder, viewers: int) -> None:
        self.bus = stack.enter_context(MemoryRouter().open())
        self.now_s = 100.0
        self.acting = Acting(lambda: self.now_s)
        self.live = LiveHandler(self.bus, Keys("test"), Clock(), encoder, self.acting)
        self.live.start()
        stack.callback(self.live.close)
        self.frames = self.bus.publisher(Keys("test").frame)
        self.woken = threading.Semaphore(0)
        self._stack = stack
        self.watch(viewers)

    def watch(self, viewers: int) -> None:
        for _ in range(viewers):
            self._stack.enter_context(self.live.watching(lambda: self.woken.release()))  # noqa: PLW0108 - one for each

    def send(self, name: str) -> FrameHeader:
        header = samples.frame_header(name, None, 1, 1)
        self.frames.put(samples.pixels(), encode(header))
        return header

    def wait(self, viewers: int) -> None:
        for _ in range(viewers):
            assert self.woken.acquire(timeout=PATIENCE_S)


def test_twenty_viewers_cost_one_encoding_of_each_frame() -> None:
    encoder = CountingEncoder()
    with ExitStack() as stack:
        watched = Watched(stack, encoder, 20)
        sent = []
        for name in ("one", "two", "three"):
            sent.append(watched.send(name).sha256)
            watched.wait(20)
        frame = watched.live.frame
    assert encoder.encoded == sent
    assert frame is not None
    assert frame.header.sha256 == sent[-1]


def test_nothing_is_encoded_while_nobody_watches_and_a_viewer_gets_the_newest() -> None:
    encoder = CountingEncoder()
    with ExitStack() as stack:
        watched = Watched(stack, encoder, 0)
        for name in ("one", "two"):
            watched.send(name)
        last = watched.send("three")
        wait_until(lambda: watched.live._heard is not None and watched.live._heard.header == last)
        assert encoder.encoded == []
        watched.watch(1)
        watched.wait(1)
    assert encoder.encoded == [last.sha256]


def test_while_somebody_acts_no_picture_is_begun_and_the_newest_comes_afterwards() -> None:
    encoder = CountingEncoder()
    with ExitStack() as stack:
        watched = Watched(stack, encoder, 1)
        watched.acting.begin()
        watched.now_s = 0.0  # his moment is not over for 100 s
        watched.send("one")
        wait_until(lambda: watched.acting.waiting == 1)
        last = watched.send("two")
        wait_until(lambda: watched.live._heard is not None and watched.live._heard.header == last)
        assert encoder.encoded == []
        watched.acting.end()
        watched.wait(1)
    assert encoder.encoded == [last.sha256]


def test_a_frame_that_ends_the_encoder_is_missed_and_the_next_one_shown() -> None:
    encoder = CountingEncoder(fails_first=True)
    with ExitStack() as stack:
        watched = Watched(stack, encoder, 1)
        watched.send("one")
        wait_until(lambda: encoder.encoded != [])
        second = watched.send("two")
        watched.wait(1)
        assert watched.live.frame is not None
        assert watched.live.frame.header.sha256 == second.sha256

import os
import queue
import threading
from pathlib import Path

import pytest
import structlog

from services.imaging.devices.folder_source import REFUSED, TAKEN, FolderSource
from services.imaging.devices.source import Refused
from shared.errors import ConfigurationError, ImageUnreadable
from tests.unit.services.registration.outside import eventually

LOG: structlog.stdlib.BoundLogger = structlog.stdlib.get_logger("folder")
PATIENCE_S = 60.0


class Taker:
    """Says what it was given; refuses files by their content."""

    def __init__(self) -> None:
        self.calls: queue.Queue[str] = queue.Queue()
        self.contents: list[bytes] = []
        self.waited_s: list[float | None] = []
        self.busy = 1

    def __call__(self, content: bytes, sender: str, waited_s: float | None = 0.0, /) -> None:
        self.contents.append(content)
        self.waited_s.append(waited_s)
        self.calls.put(sender)
        if content == b"rubbish":
            raise ImageUnreadable("rubbish")
        if content == b"later" and self.busy:
            self.busy -= 1
            raise Refused("busy")


def test_files_are_moved_to_where_they_belong(tmp_path: Path) -> None:
    taker = Taker()
    (tmp_path / "bad.png").write_bytes(b"rubbish")
    (tmp_path / "good.png").write_bytes(b"image")
    for name in (".hidden", "half.part", "half.tmp"):
        (tmp_path / name).write_bytes(b"image")
    with FolderSource(tmp_path, LOG).receiving(taker):
        names = {taker.calls.get(timeout=PATIENCE_S) for _ in range(2)}
    assert names == {"bad.png", "good.png"}
    assert (tmp_path / TAKEN / "good.png").is_file()
    assert (tmp_path / REFUSED / "bad.png").is_file()
    assert (tmp_path / "half.part").is_file()
    assert taker.calls.empty()


def test_a_file_that_could_not_be_taken_now_is_offered_again(tmp_path: Path) -> None:
    taker = Taker()
    (tmp_path / "shot.png").write_bytes(b"later")
    with FolderSource(tmp_path, LOG).receiving(taker):
        assert [taker.calls.get(timeout=PATIENCE_S) for _ in range(2)] == ["shot.png", "shot.png"]
    assert (tmp_path / TAKEN / "shot.png").is_file()


def test_the_oldest_comes_first(tmp_path: Path) -> None:
    for age, name in enumerate(("third.png", "second.png", "first.png")):
        (tmp_path / name).write_bytes(b"image")
        os.utime(tmp_path / name, (1000.0 - age, 1000.0 - age))
    taker = Taker()
    with FolderSource(tmp_path, LOG).receiving(taker):
        assert [taker.calls.get(timeout=PATIENCE_S) for _ in range(3)] == ["first.png", "second.png", "third.png"]


def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    source = FolderSource(tmp_path / "file", LOG)
    with (
        pytest.raises(ConfigurationError, match=r"cannot be written .* set another watched_folder"),
        source.receiving(Taker()),
    ):
        pass


class Clock:
    """Goes on by a second whenever it is asked."""

    now_s = 100.0

    def __call__(self) -> float:
        self.now_s += 1.0
        return self.now_s


def test_nobody_knows_how_long_a_file_has_waited_that_lay_there_at_the_start(tmp_path: Path) -> None:
    taker = Taker()
    (tmp_path / "old.png").write_bytes(b"image")
    with FolderSource(tmp_path, LOG, Clock()).receiving(taker):
        assert taker.calls.get(timeout=PATIENCE_S) == "old.png"
        (tmp_path / "new.png").write_bytes(b"image")
        assert taker.calls.get(timeout=PATIENCE_S) == "new.png"
    old_s, new_s = taker.waited_s
    assert old_s is None
    assert new_s is not None
    assert new_s >= 3.0, "since the last look without it: that which found it, that which found it whole, the offer"


def test_a_file_that_is_offered_again_has_waited_for_longer(tmp_path: Path) -> None:
    taker = Taker()
    with FolderSource(tmp_path, LOG, Clock()).receiving(taker):
        (tmp_path / "shot.png").write_bytes(b"later")
        for _ in range(2):
            taker.calls.get(timeout=PATIENCE_S)
    first_s, again_s = taker.waited_s
    assert first_s is not None
    assert again_s is not None
    assert again_s >= first_s + 2.0, "the next look, the next offer"


class Watched(FolderSource):
    """Says how often it has looked into its folder."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, LOG, self._counted)
        self._looked, self._count = threading.Condition(), 0

    def looks_again(self, count: int) -> None:
        """Wait until it has asked its clock so many times more, as it does at each look."""
        with self._looked:
            until = self._count + count
            assert self._looked.wait_for(lambda: self._count >= until, PATIENCE_S)

    def _counted(self) -> float:
        with self._looked:
            self._count += 1
            self._looked.notify_all()
            return float(self._count)


@pytest.mark.parametrize(("content", "folder"), [(b"image", TAKEN), (b"rubbish", REFUSED)])
def test_a_file_that_cannot_be_moved_is_taken_once_and_moved_when_it_can_be(
    tmp_path: Path, content: bytes, folder: str
) -> None:
    taker, source, target = Taker(), Watched(tmp_path), tmp_path / folder / "shot.png"
    with source.receiving(taker), structlog.testing.capture_logs() as logged:
        target.mkdir()
        (tmp_path / "shot.png").write_bytes(content)
        taker.calls.get(timeout=PATIENCE_S)
        source.looks_again(4)
        target.rmdir()
        eventually(target.is_file)
    assert taker.contents == [content]
    assert [one["detail"].partition("; ")[2] for one in logged if one["event"] == "file not moved"] == [
        "it is not taken again: move it away, or what stands in its place"
    ]


def test_a_folder_for_taken_files_that_was_deleted_is_made_again(tmp_path: Path) -> None:
    taker = Taker()
    with FolderSource(tmp_path, LOG).receiving(taker):
        (tmp_path / TAKEN).rmdir()
        (tmp_path / "shot.png").write_bytes(b"image")
        eventually((tmp_path / TAKEN / "shot.png").is_file)
    assert taker.contents == [b"image"]


def test_another_file_of_the_name_of_one_that_could_not_be_moved_is_taken(tmp_path: Path) -> None:
    taker = Taker()
    with FolderSource(tmp_path, LOG).receiving(taker):
        (tmp_path / TAKEN / "shot.png").mkdir()
        for content in (b"first", b"the second"):
            (tmp_path / "shot.png").write_bytes(content)
            taker.calls.get(timeout=PATIENCE_S)
    assert taker.contents == [b"first", b"the second"]


class Overwriting(Taker):
    """While it takes the first image, the next one is written over it."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self._file = file

    def __call__(self, content: bytes, sender: str, waited_s: float | None = 0.0, /) -> None:
        if content == b"first":
            self._file.write_bytes(b"the second")
        super().__call__(content, sender, waited_s)


def test_a_file_that_is_overwritten_while_it_is_taken_is_taken_as_well(tmp_path: Path) -> None:
    taker = Overwriting(tmp_path / "current.png")
    with FolderSource(tmp_path, LOG).receiving(taker):
        (tmp_path / "current.png").write_bytes(b"first")
        eventually((tmp_path / TAKEN / "current.png").is_file)
    assert taker.contents == [b"first", b"the second"]
    assert (tmp_path / TAKEN / "current.png").read_bytes() == b"the second"


class Copying(Taker):
    """While it takes the first image, half of the second is written over it; the rest comes before the next look."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self._file, self._rest = file, False

    def __call__(self, content: bytes, sender: str, waited_s: float | None = 0.0, /) -> None:
        if content == b"first":
            self._file.write_bytes(b"the")
            self._rest = True
        super().__call__(content, sender, waited_s)

    def clock(self) -> float:
        if self._rest:
            self._rest = False
            self._file.write_bytes(b"the second")
        return 100.0


def test_a_file_that_changes_between_the_look_and_its_reading_is_not_taken_half(tmp_path: Path) -> None:
    taker = Copying(tmp_path / "b.png")
    for age, name, content in ((2.0, "a.png", b"first"), (1.0, "b.png", b"an earlier one")):
        (tmp_path / name).write_bytes(content)
        os.utime(tmp_path / name, (1000.0 - age, 1000.0 - age))
    with FolderSource(tmp_path, LOG, taker.clock).receiving(taker):
        eventually((tmp_path / TAKEN / "b.png").is_file)
    assert taker.contents == [b"first", b"the second"]


class Unreachable(Taker):
    """Cannot take the first image; its folder goes away meanwhile."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder

    def __call__(self, content: bytes, sender: str, waited_s: float | None = 0.0, /) -> None:
        if self.busy:
            self._folder.rename(self._folder.with_name("away"))
        super().__call__(content, sender, waited_s)


def test_files_are_not_new_after_their_folder_could_not_be_read_for_a_while(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "old.png").write_bytes(b"later")
    taker, source = Unreachable(folder), Watched(folder)
    with source.receiving(taker):
        taker.calls.get(timeout=PATIENCE_S)
        source.looks_again(2)
        folder.with_name("away").rename(folder)
        taker.calls.get(timeout=PATIENCE_S)
    assert taker.waited_s == [None, None]


def test_a_file_that_was_removed_while_it_was_taken_is_no_error(tmp_path: Path) -> None:
    taker, source, file = Taker(), Watched(tmp_path), tmp_path / "shot.png"

    def take(content: bytes, sender: str, waited_s: float | None = 0.0, /) -> None:
        file.unlink()
        taker(content, sender, waited_s)

    with source.receiving(take), structlog.testing.capture_logs() as logged:
        file.write_bytes(b"image")
        taker.calls.get(timeout=PATIENCE_S)
        source.looks_again(2)
    assert logged == []

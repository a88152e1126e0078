import os
import queue
from pathlib import Path

import pytest
import structlog

from services.imaging.devices.folder_source import REFUSED, TAKEN, FolderSource
from services.imaging.devices.source import Refused
from shared.errors import ConfigurationError, ImageUnreadable

LOG: structlog.stdlib.BoundLogger = structlog.stdlib.get_logger("folder")
PATIENCE_S = 60.0


class Taker:
    """Says what it was given; refuses files by their content."""

    def __init__(self) -> None:
        self.calls: queue.Queue[str] = queue.Queue()
        self.busy = 1

    def __call__(self, content: bytes, sender: str) -> None:
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

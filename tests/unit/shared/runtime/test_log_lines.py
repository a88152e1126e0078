"""Log lines on their way out: bounded, counted, and never an error for whoever logs."""

import errno
import os
import threading
from pathlib import Path

import pytest

from shared.runtime.log_lines import LineWriter, RotatingFile, StandardError

PATIENCE_S = 60.0


class Sink:
    """Keeps lines; its disk can be full, and it can hang."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.full = False
        self.goes_on = threading.Event()
        self.goes_on.set()

    def write(self, line: str) -> None:
        assert self.goes_on.wait(PATIENCE_S)
        if self.full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.lines.append(line)


def writer_to(sink: Sink, most_waiting: int = 8) -> LineWriter:
    return LineWriter(sink, lambda count, why: f"{count} dropped: {why}", most_waiting)


def test_lines_go_through_in_order() -> None:
    sink = Sink()
    writer = writer_to(sink)
    for line in ("one", "two", "three"):
        writer.put(line)
    assert writer.flush(PATIENCE_S)
    assert sink.lines == ["one", "two", "three"]


def test_lines_that_cannot_be_written_are_counted_and_reported_before_the_next() -> None:
    sink = Sink()
    writer = writer_to(sink)
    sink.full = True
    for line in ("one", "two"):
        writer.put(line)
    assert writer.flush(PATIENCE_S)
    sink.full = False
    writer.put("three")
    assert writer.flush(PATIENCE_S)
    assert sink.lines == ["2 dropped: [Errno 28] No space left on device", "three"]
    assert writer.dropped == 2


def test_who_logs_does_not_wait_for_a_sink_that_hangs() -> None:
    sink = Sink()
    writer = writer_to(sink, most_waiting=4)
    sink.goes_on.clear()
    for number in range(20):
        writer.put(str(number))
    assert not writer.flush(0.0)
    sink.goes_on.set()
    assert writer.flush(PATIENCE_S)
    assert writer.dropped in (15, 16)  # one line may have left the queue before the sink hung
    assert len(sink.lines) + writer.dropped in (20, 21)  # and the notice


def test_a_closed_writer_writes_what_it_has_and_drops_the_rest() -> None:
    sink = Sink()
    writer = writer_to(sink)
    writer.put("last")
    writer.close()
    assert writer.flush(PATIENCE_S)
    writer.put("too late")
    assert sink.lines == ["last"]
    assert writer.dropped == 1


def test_a_log_file_has_a_bounded_size(tmp_path: Path) -> None:
    path = tmp_path / "log" / "robot.jsonl"
    file = RotatingFile(path, most_bytes=100, kept=3)
    for number in range(100):
        file.write(f"line {number:03d}")
    files = sorted(path.parent.iterdir())
    assert [f.name for f in files] == ["robot.jsonl", "robot.jsonl.1", "robot.jsonl.2"]
    assert all(f.stat().st_size <= 100 for f in files)
    assert path.read_text().splitlines()[-1] == "line 099"


def test_a_log_file_goes_on_where_it_ended(tmp_path: Path) -> None:
    path = tmp_path / "robot.jsonl"
    for line in ("one", "two"):
        file = RotatingFile(path)
        file.write(line)
        file.close()
    assert path.read_text() == "one\ntwo\n"


def test_a_log_file_whose_folder_cannot_be_is_tried_again(tmp_path: Path) -> None:
    (tmp_path / "log").write_text("no folder")
    file = RotatingFile(tmp_path / "log" / "robot.jsonl")
    with pytest.raises(OSError, match="File exists"):
        file.write("one")
    (tmp_path / "log").unlink()
    file.write("two")
    assert (tmp_path / "log" / "robot.jsonl").read_text() == "two\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_an_error_of_the_sink(tmp_path: Path) -> None:
    path = tmp_path / "robot.jsonl"
    path.symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left"):
        RotatingFile(path).write("one")


def test_standard_error_is_what_it_is_at_that_moment(capsys: pytest.CaptureFixture[str]) -> None:
    StandardError().write("one")
    assert capsys.readouterr().err == "one\n"


def test_standard_error_that_is_closed_is_an_error_of_the_sink(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", None)
    with pytest.raises(OSError, match="standard error is closed"):
        StandardError().write("one")


def test_a_log_file_that_another_process_rotated_is_opened_again(tmp_path: Path) -> None:
    path = tmp_path / "ui_api.jsonl"
    first, second = RotatingFile(path, most_bytes=20), RotatingFile(path, most_bytes=20)
    for number in range(4):
        first.write(f"first {number:03d}")
        second.write(f"second {number:03d}")
    assert path.stat().st_size <= 20
    assert path.read_text().splitlines()[-1] == "second 003"

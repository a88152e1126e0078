"""Numbers of images: on the disk before anybody hears of them, without a gap, also over restarts."""

import sqlite3
from pathlib import Path

import pytest

from services.imaging.devices.image_index import ImageIndex
from shared.errors import ConfigurationError


def filled(file: Path, count: int) -> ImageIndex:
    index = ImageIndex(file)
    for sequence in range(1, count + 1):
        index.add(sequence, f"{sequence:064d}", f"header {sequence}".encode(), in_run=sequence % 2 == 0)
    return index


def test_numbers_and_the_stores_name_outlive_the_process(tmp_path: Path) -> None:
    before = filled(tmp_path / "index.sqlite", 3)
    after = ImageIndex(tmp_path / "index.sqlite")
    assert after.store_id == before.store_id
    assert after.newest_sequence() == 3
    assert [(one.sequence, one.header, one.state) for one in after.after(1, 10)] == [
        (2, b"header 2", "pending"),
        (3, b"header 3", "pending"),
    ]
    assert ImageIndex(tmp_path / "another.sqlite").store_id != before.store_id


def test_a_number_is_given_once(tmp_path: Path) -> None:
    index = filled(tmp_path / "index.sqlite", 1)
    with pytest.raises(OSError, match="cannot be read or written: UNIQUE"):
        index.add(1, "0" * 64, b"another", in_run=False)
    assert index.after(0, 10)[0].header == b"header 1"


def test_the_newest_waits_at_the_front_and_overtaken_frames_of_runs_do_not_wait(tmp_path: Path) -> None:
    index = filled(tmp_path / "index.sqlite", 6)
    index.skip_overtaken_frames(6, "superseded", "a newer one came")
    index.put_calibration(6, b"calibration")
    states = [(one.sequence, one.state) for one in index.after(0, 10)]
    assert states == [(1, "pending"), (2, "skipped"), (3, "pending"), (4, "skipped"), (5, "pending"), (6, "done")]
    newest = index.newest_pending()
    assert newest is not None
    assert newest.sequence == 5
    assert index.calibration(6) == b"calibration"
    assert index.calibration(5) is None
    assert (index.is_pending(5), index.is_pending(6), index.is_pending(7)) == (True, False, False)


def test_a_damaged_index_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "index.sqlite").write_bytes(b"no database" * 1000)
    with pytest.raises(ConfigurationError, match=r"cannot be used \(.*\); move it away: the images stay"):
        ImageIndex(tmp_path / "index.sqlite")


def test_an_index_that_another_process_holds_is_an_error_of_the_disk(tmp_path: Path) -> None:
    index = filled(tmp_path / "index.sqlite", 1)
    with sqlite3.connect(tmp_path / "index.sqlite") as other:
        other.execute("DROP TABLE images")
    with pytest.raises(OSError, match="no such table"):
        index.newest_sequence()


def test_an_image_is_known_by_its_hash_and_by_its_uid_also_from_an_index_of_an_earlier_release(tmp_path: Path) -> None:
    file = tmp_path / "index.sqlite"
    index = filled(file, 1)
    index.add(2, "a" * 64, b'{"sop_instance_uid": "1.2.3"}', in_run=False)
    with sqlite3.connect(file) as earlier:
        earlier.execute("DROP INDEX images_by_uid")
    opened = ImageIndex(file)
    assert opened.has("b" * 64, "1.2.3")
    assert opened.has(f"{1:064d}", "1.2.4")
    assert not opened.has("b" * 64, "1.2.4")

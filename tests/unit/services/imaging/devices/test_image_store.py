import hashlib
from pathlib import Path

import pytest

from services.imaging.devices.image_store import ImageStore, write_atomically
from shared.errors import ConfigurationError


def test_an_image_is_found_again_by_its_hash(tmp_path: Path) -> None:
    store = ImageStore(tmp_path / "images")
    sha256 = store.put(b"content")
    assert sha256 == hashlib.sha256(b"content").hexdigest()
    assert store.get(sha256) == b"content"
    assert ImageStore(tmp_path / "images").get(sha256) == b"content"
    assert store.get_header(sha256) is None
    store.path(sha256).with_suffix(".json").write_bytes(b"of an older version")
    assert store.get_header(sha256) == b"of an older version"
    store.index.add(1, sha256, b"first", in_run=False)
    store.index.add(2, sha256, b"second", in_run=False)
    assert ImageStore(tmp_path / "images").get_header(sha256) == b"second"


def test_keeping_the_same_image_twice_changes_nothing(tmp_path: Path) -> None:
    store = ImageStore(tmp_path)
    sha256 = store.put(b"content")
    before = store.path(sha256).stat().st_mtime_ns
    assert store.put(b"content") == sha256
    assert store.path(sha256).stat().st_mtime_ns == before


def test_nothing_half_written_is_left(tmp_path: Path) -> None:
    store = ImageStore(tmp_path)
    store.put(b"content")
    files = [p for p in tmp_path.rglob("*") if p.is_file() and not p.name.startswith("index.sqlite")]
    assert [p.suffix for p in files] == [".dcm"]


def test_a_hash_that_is_not_here_or_not_a_hash_brings_nothing(tmp_path: Path) -> None:
    store = ImageStore(tmp_path)
    assert store.get("0" * 64) is None
    assert store.get("../../etc/passwd") is None
    assert store.get_header("") is None


def test_a_write_that_fails_leaves_no_file(tmp_path: Path) -> None:
    store = ImageStore(tmp_path)
    sha256 = hashlib.sha256(b"content").hexdigest()
    (tmp_path / sha256[:2]).write_bytes(b"a file where the folder must be")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(OSError, match=r"exists|directory"):
        store.put(b"content")
    assert sorted(tmp_path.iterdir()) == before


def test_a_write_that_fails_at_the_last_step_takes_its_temporary_file_away(tmp_path: Path) -> None:
    store = ImageStore(tmp_path)
    file = tmp_path / "folder" / "file"
    file.mkdir(parents=True)
    with pytest.raises(OSError, match="directory"):
        write_atomically(file, b"content")
    assert sorted(file.parent.iterdir()) == [file]
    assert store.get(hashlib.sha256(b"content").hexdigest()) is None


def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(ConfigurationError, match=r"for images cannot be made: .*; set another state_dir"):
        ImageStore(tmp_path / "file" / "images")

"""What impairs any service: a disk that is nearly full, log lines that cannot be written, handlers that fail."""

import shutil
from pathlib import Path

from shared.runtime.impairments import nearly_full


def test_enough_space_impairs_nothing(tmp_path: Path) -> None:
    assert nearly_full(tmp_path / "not yet there", 0.0) is None


def test_a_disk_with_too_little_space_is_named_with_what_is_left_and_what_to_do(tmp_path: Path) -> None:
    free_mib = shutil.disk_usage(tmp_path).free / 2**20
    sentence = nearly_full(tmp_path, 2.0 * free_mib + 1.0)
    assert sentence is not None
    assert sentence.startswith(f"the disk of {tmp_path} has ")
    assert f" MiB free (limit {2.0 * free_mib + 1.0:g} MiB); free some space" in sentence


def test_a_folder_that_cannot_be_asked_impairs(tmp_path: Path) -> None:
    sentence = nearly_full(tmp_path / ("x" * 300), 1.0)
    assert sentence is not None
    assert "cannot be asked for its free space (File name too long); see to the disk" in sentence

"""What impairs any service: a disk that is nearly full, log lines that cannot be written, handlers that fail."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from shared.runtime import impairments
from shared.runtime.impairments import _filling_of, _lack_of, is_lack_of_memory, nearly_full


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


def _disk(**changes: int) -> os.statvfs_result:
    known = {"f_frsize": 4096, "f_bavail": 2**20, "f_files": 100, "f_favail": 10, "f_flag": 0}
    names = ("f_bsize", "f_frsize", "f_blocks", "f_bfree", "f_bavail", "f_files", "f_ffree", "f_favail", "f_flag")
    return os.statvfs_result([(known | changes).get(name, 0) for name in (*names, "f_namemax")])


@pytest.mark.parametrize(
    ("changes", "lack"),
    [
        ({}, None),
        ({"f_files": 0, "f_favail": 0}, None),
        ({"f_flag": os.ST_RDONLY}, "is mounted read-only"),
        ({"f_favail": 0}, "has room for no more files"),
        ({"f_bavail": 256 * 63}, r"has 63 MiB free \(limit 64 MiB\)"),
    ],
)
def test_a_disk_that_takes_nothing_impairs(changes: dict[str, int], lack: str | None) -> None:
    sentence = _lack_of(_disk(**changes), Path("/state"), 64.0)
    assert (sentence is None) if lack is None else re.search(lack, str(sentence))


@pytest.mark.parametrize(
    ("free_mib", "all_mib", "limit_mib"),
    [(9999, 100_000, 10_000), (10_000, 100_000, None), (10_239, 10**6, 10_240), (10_240, 10**6, None)],
)
def test_a_disk_that_fills_is_announced_at_a_tenth(free_mib: int, all_mib: int, limit_mib: int | None) -> None:
    disk = _disk(f_bavail=256 * free_mib, f_blocks=256 * all_mib)
    sentence = _filling_of(disk, Path("/state"), 10.0, 10_240.0)
    expected = f"fills: {free_mib} MiB of {all_mib} MiB are free (limit {limit_mib} MiB); remove what has been kept"
    assert (sentence is None) if limit_mib is None else expected in str(sentence)


def _in_a_process_with(limit: str, function: str) -> str:
    """What a process says of itself whose limit is set to what it uses and 1 MiB, or 3 handles."""
    program = (
        "import os, resource\n"
        "from pathlib import Path\n"
        f"from shared.runtime.impairments import {function}\n"
        f"print({function}())\n"
        "pages = int(Path('/proc/self/statm').read_text().split()[0])\n"
        "handles = len(os.listdir('/proc/self/fd'))\n"
        f"resource.setrlimit(resource.{limit})\n"
        f"print({function}())\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    before, after = ended.stdout.splitlines()
    assert before == "None"
    return after


def test_a_process_with_few_handles_left_is_impaired() -> None:
    said = _in_a_process_with("RLIMIT_NOFILE, (handles + 3, handles + 3)", "nearly_out_of_handles")
    assert re.search(r"\d+ handles .* in use \(limit \d+, at least 16 must be free\); raise the limit", said)


def test_a_process_with_no_handle_left_is_impaired() -> None:
    said = _in_a_process_with("RLIMIT_NOFILE, (0, 0)", "nearly_out_of_handles")
    assert said.startswith("0 handles for files and connections are in use (limit 0,")


def test_a_process_with_little_memory_left_is_impaired() -> None:
    limit = "RLIMIT_AS, (pages * resource.getpagesize() + 2**20,) * 2"
    said = _in_a_process_with(limit, "nearly_out_of_memory")
    assert said.endswith("MiB of the process's address space are left (limit 64 MiB); raise its limit (ulimit -v)")


def test_what_counts_as_lack_of_memory() -> None:
    with pytest.raises(cv2.error) as lacking:
        cv2.resize(np.zeros((1, 1), np.uint8), (2**30, 2**30))
    with pytest.raises(cv2.error) as other:
        cv2.resize(np.zeros((0, 0), np.uint8), (1, 1))
    assert [is_lack_of_memory(e) for e in (MemoryError(), lacking.value, other.value, ZeroDivisionError())] == [
        True,
        True,
        False,
        False,
    ]


def test_any_error_of_a_process_that_is_short_of_memory_counts_as_lack_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(impairments, "nearly_out_of_memory", lambda: "3 MiB are left")
    assert is_lack_of_memory(SystemError("a function returned a result with an exception set"))

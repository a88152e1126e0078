"""Which files of a folder are images."""

from pathlib import Path

import numpy as np
import pytest

from distalock.image_files import images_in
from services.imaging.devices.dicom_file import dicom_of_pixels
from shared.errors import InputError

# Opens as a file, but nothing can be read at its beginning.
UNREADABLE = Path("/proc/self/mem")


def test_images_are_told_by_their_ending_and_dicom_files_by_their_content(tmp_path: Path) -> None:
    dicom, uid = dicom_of_pixels(np.zeros((8, 8), np.uint16))
    for name in ("IM0001", uid, "shot.dcm.1"):
        (tmp_path / name).write_bytes(dicom)
    for name in ("a.PNG", "b.tif", "broken.dcm"):
        (tmp_path / name).write_bytes(b"")
    for name in ("qa.json", "README", "notes.txt"):
        (tmp_path / name).write_bytes(b"no image")
    (tmp_path / "qa").mkdir()
    assert {f.name for f in images_in(tmp_path)} == {"IM0001", uid, "shot.dcm.1", "a.PNG", "b.tif", "broken.dcm"}


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone: cannot be read: No such file or directory; allow it, or name another"):
        images_in(tmp_path / "gone")


@pytest.mark.skipif(not UNREADABLE.exists(), reason="needs Linux's /proc")
def test_a_file_whose_content_cannot_be_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"")
    (tmp_path / "IM0001").symlink_to(UNREADABLE)
    with pytest.raises(InputError, match=r"IM0001: cannot be read: .*; allow it, or move it out of the folder"):
        images_in(tmp_path)

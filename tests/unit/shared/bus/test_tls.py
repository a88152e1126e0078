"""Which files prove who a program is, and which are refused."""

from pathlib import Path

import pytest

from shared.bus.tls import TlsFiles
from shared.errors import ConfigurationError


def files_in(folder: Path, *, key_mode: int) -> TlsFiles:
    files = TlsFiles.in_folder(folder)
    for file in (files.authority, files.certificate, files.key):
        file.write_text("content")
    files.key.chmod(key_mode)
    return files


def test_files_that_are_there_and_private_are_taken(tmp_path: Path) -> None:
    files_in(tmp_path, key_mode=0o400).require()


@pytest.mark.parametrize("name", ["authority", "certificate", "key"])
def test_a_missing_file_is_named_with_the_remedy(tmp_path: Path, name: str) -> None:
    files = files_in(tmp_path, key_mode=0o600)
    file: Path = getattr(files, name)
    file.unlink()
    with pytest.raises(ConfigurationError, match=f"{file} is missing: .* make it \\(distalock pki init\\)"):
        files.require()


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604])
def test_a_key_that_others_can_read_is_refused(tmp_path: Path, mode: int) -> None:
    with pytest.raises(ConfigurationError, match=f"can be read by others \\(mode {mode:04o}, 0600 is needed\\)"):
        files_in(tmp_path, key_mode=mode).require()

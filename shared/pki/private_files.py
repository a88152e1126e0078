"""Files and folders for their owner's eyes only."""

import os
import secrets
from pathlib import Path

from shared.errors import ConfigurationError


def read_file(file: Path) -> bytes:
    """Content of a file; raises `ConfigurationError`."""
    try:
        return file.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"{file} cannot be read: {error.strerror or error}") from None


def private_folder(folder: Path) -> Path:
    """Make a folder that its owner alone can enter; raises `ConfigurationError`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o700)
    except OSError as error:
        raise ConfigurationError(f"{folder} cannot be written: {error.strerror or error}") from None
    return folder


def write_private(file: Path, content: bytes) -> None:
    """Replace a file as a whole; nobody but the owner can read it at any moment. Raises `ConfigurationError`."""
    new = file.with_name(f".{file.name}.{secrets.token_hex(4)}")
    try:
        with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as handle:
            handle.write(content)
            handle.flush()
            os.fsync(handle.fileno())
        new.replace(file)
    except OSError as error:
        raise ConfigurationError(f"{file} cannot be written: {error.strerror or error}") from None

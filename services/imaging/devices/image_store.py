"""Images as files, addressed by the SHA-256 of their content, and an index of their numbers and headers.

A file appears whole or not at all: it is written under another name, flushed to the disk, then renamed.
"""

import os
import re
import tempfile
from pathlib import Path

from services.imaging.devices.image_index import ImageIndex
from shared.errors import ConfigurationError
from shared.parts.files import sha256_of

# Of an image of 2048 x 2048 pixels with 16 bits.
_PROBE_BYTES = 2 * 2048**2
_HASH = re.compile(r"[0-9a-f]{64}")


class ImageStore:
    """A folder of images.

    Parameters
    ----------
    folder
        Created when it is not there; raises `ConfigurationError` when that fails.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigurationError(
                f"folder {folder} for images cannot be made: {error.strerror or error}; set another state_dir"
            ) from None
        self.index = ImageIndex(folder / "index.sqlite")

    def put(self, content: bytes) -> str:
        """Keep an image; returns its SHA-256. Keeping the same image again changes nothing.

        Raises
        ------
        OSError
            When the disk does not take it; nothing is left half-written.
        """
        sha256 = sha256_of(content)
        file = self.path(sha256)
        if not file.exists():
            write_atomically(file, content)
        return sha256

    def has(self, sha256: str, sop_instance_uid: str) -> bool:
        """Whether an image was kept, in these or in other bytes; also one without a number, or whose file is gone."""
        return self.path(sha256).exists() or self.index.has(sha256, sop_instance_uid)

    def takes_images(self) -> bool:
        """Whether an image would be kept now: as much is written, a number too, and removed again."""
        probe = self._folder / ".probe"
        try:
            write_atomically(probe, bytes(_PROBE_BYTES))
            probe.unlink()
            self.index.require_writable()
        except OSError:
            return False
        return True

    def get(self, sha256: str) -> bytes | None:
        """An image's content, or None when it is not here."""
        return _content(self.path(sha256)) if _HASH.fullmatch(sha256) else None

    def get_header(self, sha256: str) -> bytes | None:
        """An image's newest header, or None when it is not here; older versions kept it in a file beside the image."""
        if not _HASH.fullmatch(sha256):
            return None
        return self.index.header(sha256) or _content(self.path(sha256).with_suffix(".json"))

    def path(self, sha256: str) -> Path:
        """Where an image is kept."""
        return self._folder / sha256[:2] / f"{sha256}.dcm"


def _content(file: Path) -> bytes | None:
    try:
        return file.read_bytes()
    except FileNotFoundError:
        return None


def write_atomically(file: Path, content: bytes) -> None:
    """Write a file so that it is there whole, on the disk, or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    descriptor, name = tempfile.mkstemp(dir=file.parent, prefix=".incoming-")
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        Path(name).replace(file)
    except OSError:
        Path(name).unlink(missing_ok=True)
        raise
    folder = os.open(file.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)

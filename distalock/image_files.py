"""Image files that a person named, read in one place; one sentence says which one cannot be used, and why."""

from dataclasses import dataclass
from pathlib import Path

from distalock.inputs import IMAGE_KINDS
from services.imaging.devices.image_file import is_dicom, read_content
from services.imaging.devices.received_image import ImageContent
from shared.errors import ImageUnreadable, InputError
from shared.parts.files import sha256_of

_SUFFIXES = frozenset({".dcm", ".png", ".tif", ".tiff"})
_DICOM_HEAD = 132


@dataclass(frozen=True, slots=True, eq=False)
class ImageFile:
    """An image file as read.

    Attributes
    ----------
    path
        As it was named.
    sha256
        Of the file's content.
    content
        Pixels, and what the file says of them.
    """

    path: Path
    sha256: str
    content: ImageContent


def images_in(folder: Path) -> list[Path]:
    """Images of a folder, sorted by name: by the ending of the name, and DICOM files by their content.

    An archive names its files by UIDs: what stands after the last full stop is no ending.

    Raises
    ------
    InputError
        When the folder, or a file in it that may be a DICOM one, cannot be read.
    """
    try:
        return sorted(file for file in folder.iterdir() if file.is_file() and _is_image(file))
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror or error}; allow it, or name another") from None


def _is_image(file: Path) -> bool:
    if file.suffix.lower() in _SUFFIXES:
        return True
    try:
        with file.open("rb") as content:
            return is_dicom(content.read(_DICOM_HEAD))
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"{file}: cannot be read: {why}; allow it, or move it out of the folder") from None


def read_image_file(file: Path, source: str | None = None) -> ImageFile:
    """Read an image file (PNG, TIFF or DICOM).

    Parameters
    ----------
    source
        What the error's sentence calls it; None to call it as it was named.

    Raises
    ------
    ImageUnreadable
        When it is not there, cannot be read, or is not an image that can be measured.
    """
    name = str(file) if source is None else source
    try:
        content = file.read_bytes()
    except OSError as error:
        raise ImageUnreadable(
            f"{name}: cannot be read: {error.strerror or error}; check the name, needed is {IMAGE_KINDS}"
        ) from None
    return ImageFile(file, sha256_of(content), read_content(content, name))


def require_different(images: tuple[ImageFile, ...]) -> None:
    """Refuse an image that is given twice: it would count as two; raises `InputError`."""
    hashes = [one.sha256 for one in images]
    for k, sha256 in enumerate(hashes):
        if sha256 in hashes[:k]:
            first = images[hashes.index(sha256)].path
            raise InputError(f"{images[k].path}: is the same image as {first}; give each image once")

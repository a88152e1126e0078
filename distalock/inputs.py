"""Input files are checked before anything heavy is imported: this module needs nothing but Python itself."""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from shared.errors import ImageUnreadable, PartFileInvalid
from shared.parts.catalogue import PartKind, catalogue_names

IMAGE_KINDS: Final = "a PNG or TIFF of 8 or 16 bits, or a DICOM file"
_PARTS: Final[tuple[PartKind, ...]] = ("ring", "guide", "nail", "hexapod")


def require_inputs(given: argparse.Namespace) -> None:
    """Refuse arguments that name files which cannot be read.

    Raises
    ------
    InputError
        With one sentence that names the first of them.
    """
    for kind in _PARTS:
        path = getattr(given, kind, None)
        if path is not None and (why := _unreadable(path)):
            known = ", ".join(catalogue_names(kind))
            raise PartFileInvalid(f"{path}: cannot be read: {why}; check its name (the catalogue has {known})")
    if given.command == "mounting-site":
        _require_images([given.image], folders=False)
    if given.command in ("locate", "verify"):
        _require_images((*getattr(given, "before", ()), *given.images), folders=getattr(given, "each", False))


def _require_images(images: Iterable[Path], *, folders: bool) -> None:
    for image in images:
        if folders:
            continue  # a file that cannot be read gets a line of its own
        if image.is_dir():
            raise ImageUnreadable(
                f"{image}: cannot be read: it is a folder; `distalock locate --each` localises each of its images"
            )
        if why := _unreadable(image):
            raise ImageUnreadable(f"{image}: cannot be read: {why}; check the name, needed is {IMAGE_KINDS}")


def _unreadable(path: Path) -> str:
    """Why a file cannot be read; empty when it can."""
    try:
        with path.open("rb"):
            return ""
    except OSError as error:
        return error.strerror or str(error)

"""The built console: its files in memory, with their types, tags and compressed forms. Pure but for reading them."""

import gzip
import mimetypes
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Final

from services.ui_api.routes.preconditions import content_hash

BUILT: Final = Path(__file__).parents[1] / "console" / "dist"
INDEX: Final = "index.html"
# Names of assets carry a hash of their content, so that they never change.
ASSETS: Final = "assets/"
_TYPES: Final = {".js": "text/javascript; charset=utf-8", ".svg": "image/svg+xml", ".woff2": "font/woff2"}
_WORTH_COMPRESSING: Final = ("text/", "image/svg", "application/json")


@dataclass(frozen=True, slots=True)
class ConsoleFile:
    """One file as it is sent.

    Attributes
    ----------
    zipped
        Compressed with gzip; None where that saves nothing.
    """

    content: bytes
    zipped: bytes | None
    media_type: str
    etag: str

    @staticmethod
    @cache
    def of(name: str, content: bytes) -> "ConsoleFile":
        """From a file's name and content; the same content is compressed once."""
        suffix = Path(name).suffix
        media_type = _TYPES.get(suffix) or mimetypes.guess_type(name)[0] or "application/octet-stream"
        zipped = gzip.compress(content, 9, mtime=0) if media_type.startswith(_WORTH_COMPRESSING) else None
        return ConsoleFile(content, zipped, media_type, f'"{content_hash(content)}"')


def console_files(folder: Path = BUILT) -> Mapping[str, ConsoleFile]:
    """All files by their path below the console's address; empty where the console was not built."""
    found = sorted(file for file in folder.rglob("*") if file.is_file() and not file.name.startswith("."))
    named = ((file.relative_to(folder).as_posix(), file.read_bytes()) for file in found)
    return MappingProxyType({name: ConsoleFile.of(name, content) for name, content in named})

"""A case record with all tables and nothing in it, made once in a process: making the tables takes long."""

import tempfile
from functools import cache
from pathlib import Path
from typing import Final

from services.ui_api.record.database import open_database
from services.ui_api.record.location import sqlite_url

_FILE: Final = "sqlite:///"


def put_new_record(url: str) -> None:
    """Put one where a database's URL says, if that is a file, is not there, and has a folder."""
    file = Path(url.removeprefix(_FILE))
    if url.startswith(_FILE) and file.parent.is_dir() and not file.exists():
        file.write_bytes(_new_record())


@cache
def _new_record() -> bytes:
    with tempfile.TemporaryDirectory(prefix="d-") as folder:
        url = sqlite_url(Path(folder))
        open_database(url).dispose()
        return Path(url.removeprefix(_FILE)).read_bytes()

"""Where results are written: looked at before the work that makes them, and written whole or not at all."""

from collections.abc import Iterable
from pathlib import Path

from shared.errors import InputError


def require_writable(file: Path) -> None:
    """Refuse a place where no file can be written; raises `InputError`."""
    if file.is_dir():
        raise InputError(f"{file}: cannot be written: it is a folder; name a file in it")
    if not file.parent.is_dir():
        raise InputError(f"{file}: cannot be written: there is no folder {file.parent}; make it, or name another")
    unfinished = _unfinished(file)
    try:
        unfinished.touch()
        unfinished.unlink()
    except OSError as error:
        raise _unwritable(file, error) from None


def require_apart(output: Path, inputs: Iterable[Path]) -> None:
    """Refuse to replace a file that the result is made from; raises `InputError`."""
    if output.resolve() in {one.resolve() for one in inputs}:
        raise InputError(f"{output}: would replace a file that the result is made from; name another file")


def write_whole(file: Path, content: bytes) -> None:
    """Write a result whole or not at all; raises `InputError`."""
    unfinished = _unfinished(file)
    try:
        unfinished.write_bytes(content)
        unfinished.replace(file)
    except OSError as error:
        raise _unwritable(file, error) from None


def _unfinished(file: Path) -> Path:
    return file.with_name(file.name + ".part")


def _unwritable(file: Path, error: OSError) -> InputError:
    return InputError(f"{file}: cannot be written: {error.strerror or error}; name a file in another folder")

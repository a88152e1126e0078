"""What only one installation on this machine may use: ports and the controller, reserved before anything is started.

A port is free until somebody listens on it, and that is seconds after a start began. Two starts at once would both find
it free, and the second one's robot service would stop the first one's moves.
"""

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from shared.errors import ConfigurationError


def reservation_folder() -> Path:
    """Where this user's reservations lie; the files stay, the locks on them go with the process."""
    return Path(tempfile.gettempdir()) / f"distalock-{os.getuid()}"


@contextmanager
def reserved(wanted: Mapping[str, str], folder: Path | None = None) -> Iterator[None]:
    """Reserve things for as long as the context lasts; the end of the process gives them free, however it ends.

    Parameters
    ----------
    wanted
        What is reserved, by name, and what to do when it is taken.

    Raises
    ------
    ConfigurationError
        When another installation has reserved one of them; then none is.
    """
    place = folder or reservation_folder()
    with ExitStack() as stack:
        for name, remedy in wanted.items():
            try:
                place.mkdir(mode=0o700, parents=True, exist_ok=True)
                lock = stack.enter_context((place / _file_name(name)).open("ab"))
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise ConfigurationError(f"{name} is used by another installation that runs now; {remedy}") from None
            except OSError as error:
                raise ConfigurationError(
                    f"{name} cannot be reserved in {place} ({error.strerror or error}); see to that folder"
                ) from None
        yield


def _file_name(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()[:16]

"""The token of the user `demo`, whom a simulation has: kept in the state folder, made when it is first wanted.

`python -m distalock.demo_user FOLDER` makes it, for containers.
"""

import secrets
import sys
from pathlib import Path
from typing import Final

from shared.pki.private_files import read_file, write_private

TOKEN_FILE: Final = "demo-token"  # noqa: S105 - a file's name
_TOKEN_BYTES: Final = 32


def demo_token(state_dir: Path) -> str:
    """The token, the same at every start; raises `ConfigurationError` when the folder cannot be written."""
    file = state_dir / TOKEN_FILE
    if not file.exists():
        state_dir.mkdir(parents=True, exist_ok=True)
        write_private(file, f"{secrets.token_urlsafe(_TOKEN_BYTES)}\n".encode())
    return read_file(file).decode("ascii").strip()


if __name__ == "__main__":
    demo_token(Path(sys.argv[1]))

"""Where the case record is by default."""

from pathlib import Path


def sqlite_url(state_dir: Path) -> str:
    """URL of the default database: a file in the state folder."""
    return f"sqlite:///{state_dir / 'case-record.sqlite'}"

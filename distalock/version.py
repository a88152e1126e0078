"""Which version this is, and of which revision of the sources."""

import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent


def revision(paths: tuple[str, ...] = ()) -> str | None:
    """Last commit that touched these paths, with a plus when some of it is not committed; None outside a checkout.

    Parameters
    ----------
    paths
        Relative to the checkout; everything if none.
    """
    if not (ROOT / ".git").exists():
        return None
    last = _git("log", "-1", "--format=%h", "--", *paths)
    return last + ("+" if _git("status", "--short", "--untracked-files=no", "--", *paths) else "") if last else None


def version_line() -> str:
    """Version, and the revision of a checkout."""
    commit = revision()
    return f"distalock {version('distalock')}" + (f", revision {commit}" if commit else "")


def _git(*words: str) -> str:
    try:
        ended = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)  # noqa: S607
    except OSError:  # there is no git
        return ""
    return ended.stdout.strip()

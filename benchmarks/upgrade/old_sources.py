"""Sources of an earlier revision in a folder of their own, ready to be run."""

import os
import subprocess
import sys
import tarfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Final

from benchmarks.common.places import ROOT
from shared.errors import InputError

_RUN: Final = ("services", "shared", "simulation", "distalock", "docs/openapi.json", "pyproject.toml")


def last_release() -> str:
    """The newest tag; raises `InputError` when there is none."""
    words = ["git", "-C", str(ROOT), "describe", "--tags", "--abbrev=0"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise InputError("no release is tagged here; name a revision to upgrade from (--from REVISION)")
    return ended.stdout.strip()


def old_sources(revision: str, folder: Path) -> Path:
    """What runs of a revision, with its kernels compiled; raises `InputError` when git does not know it."""
    words = ["git", "-C", str(ROOT), "archive", revision, *_RUN]
    ended = subprocess.run(words, capture_output=True, check=False)
    if ended.returncode != 0:
        raise InputError(
            f"git cannot give the sources of '{revision}': {ended.stderr.decode(errors='replace').strip()}"
        )
    with tarfile.open(fileobj=BytesIO(ended.stdout)) as archive:
        archive.extractall(folder, filter="data")
    subprocess.run([sys.executable, "-m", "distalock.prepare"], env=environment_of(folder), check=True, cwd=folder)
    return folder


def running_from(folder: Path) -> Mapping[str, str]:
    """Variables with which Python imports from a folder, and not from where it was started."""
    return {"PYTHONPATH": str(folder), "PYTHONSAFEPATH": "1"}


def environment_of(folder: Path) -> dict[str, str]:
    """The environment of this process with those variables."""
    return {**os.environ, **running_from(folder)}

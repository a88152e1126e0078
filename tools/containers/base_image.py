"""The base layer: Python's own image where a registry can be reached, else one made by debootstrap."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from shared.errors import ConfigurationError

BASE_VARIABLE: Final = "DISTALOCK_BASE_IMAGE"
OFFICIAL: Final = "python:3.11-slim"
MADE: Final = "distalock-base:bookworm"
_PACKAGES: Final = "python3,python3-pip,ca-certificates"
_TRUSTED: Final = Path("/etc/ssl/certs/ca-certificates.crt")
# Of no use in an image, and a third of its size.
_LEFT_OUT: Final = ("var/cache/apt", "var/lib/apt/lists", "usr/share/doc", "usr/share/man", "usr/share/locale")
# Chosen: a registry that is there answers at once.
_PULL_WITHIN_S: Final = 120.0


def base_image() -> str:
    """Name of the base image, which is there afterwards; raises `ConfigurationError` when none can be had."""
    if given := os.environ.get(BASE_VARIABLE):
        return given
    for name in (OFFICIAL, MADE):
        if _succeeds("docker", "image", "inspect", name):
            return name
    if _succeeds("docker", "pull", "--quiet", OFFICIAL):
        return OFFICIAL
    return _made()


def _made() -> str:
    """Debian's Python as an image: for places where no registry can be reached."""
    if shutil.which("debootstrap") is None or os.geteuid() != 0:
        raise ConfigurationError(
            f"{OFFICIAL} cannot be pulled, and only root can make an image, with debootstrap; install debootstrap, or "
            f"name a base image with Python 3.11 ({BASE_VARIABLE})"
        )
    print(f"no registry can be reached: making {MADE} with debootstrap", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "root"
        words = ["debootstrap", "--variant=minbase", f"--include={_PACKAGES}", "bookworm", str(root)]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
        for left_out in _LEFT_OUT:
            shutil.rmtree(root / left_out, ignore_errors=True)
            (root / left_out).mkdir()
        (root / "usr/bin/python").symlink_to("python3")
        if _TRUSTED.is_file():  # what this machine trusts, builds on it trust too
            shutil.copy(_TRUSTED, root / _TRUSTED.relative_to("/"))
        archive = Path(folder) / "root.tar"
        subprocess.run(["tar", "--create", "--directory", str(root), "--file", str(archive), "."], check=True)
        subprocess.run(["docker", "import", str(archive), MADE], check=True, stdout=subprocess.DEVNULL)
    return MADE


def _succeeds(*words: str) -> bool:
    try:
        ended = subprocess.run(words, check=False, capture_output=True, timeout=_PULL_WITHIN_S)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return ended.returncode == 0

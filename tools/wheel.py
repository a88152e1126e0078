"""The wheel, built from the files that git knows and the console as built from them.

Nothing left over from earlier builds goes in, and neither time nor rights of files: one revision makes one wheel, byte
for byte.
"""

import os
import shutil
import subprocess
import sys
from datetime import datetime
from pathlib import Path
from typing import Final

from tools.console import DIST, build

ROOT: Final = Path(__file__).resolve().parents[1]
# Whatever the mask of whoever builds is.
_FOLDER_MODE: Final = 0o755
_FILE_MODE: Final = 0o644
# What the format of a wheel takes its times from; it knows none before 1980.
_TIME: Final = "SOURCE_DATE_EPOCH"


def built_wheel(folder: Path, made_at: datetime) -> Path:
    """Build it into a folder; its files carry the time of the revision."""
    sources = folder / "sources"
    for file in known_files():
        if (ROOT / file).is_file():
            (sources / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / file, sources / file)
    build()
    shutil.copytree(DIST, sources / DIST.relative_to(ROOT))
    _normalise(sources)
    words = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(sources)]
    environment = {**os.environ, _TIME: str(int(made_at.timestamp()))}
    subprocess.run([sys.executable, "-m", "pip", *words], check=True, env=environment)
    shutil.rmtree(sources)
    return next(folder.glob("distalock-*.whl"))


def _normalise(folder: Path) -> None:
    for path in folder.rglob("*"):
        path.chmod(_FOLDER_MODE if path.is_dir() else _FILE_MODE)


def known_files() -> list[str]:
    """Files that git knows, relative to the checkout."""
    listed = subprocess.run(["git", "-C", str(ROOT), "ls-files"], capture_output=True, text=True, check=True)
    return listed.stdout.splitlines()

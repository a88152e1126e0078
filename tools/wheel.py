"""The wheel, built from the files that git knows and the console as built from them.

Nothing left over from earlier builds goes in.
"""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

from tools.console import DIST, build

ROOT: Final = Path(__file__).resolve().parents[1]


def built_wheel(folder: Path) -> Path:
    """Build it into a folder."""
    sources = folder / "sources"
    for file in known_files():
        if (ROOT / file).is_file():
            (sources / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / file, sources / file)
    build()
    shutil.copytree(DIST, sources / DIST.relative_to(ROOT))
    words = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(sources)]
    subprocess.run([sys.executable, "-m", "pip", *words], check=True)
    shutil.rmtree(sources)
    return next(folder.glob("distalock-*.whl"))


def known_files() -> list[str]:
    """Files that git knows, relative to the checkout."""
    listed = subprocess.run(["git", "-C", str(ROOT), "ls-files"], capture_output=True, text=True, check=True)
    return listed.stdout.splitlines()

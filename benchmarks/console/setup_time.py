"""What the console adds to `make setup`: packages from the registry's cache or the network, types, and the build."""

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from benchmarks.common.places import ROOT
from benchmarks.console.section import Section, table

TITLE: Final = "Setup"
LIMIT_S: Final = 60.0
_CONSOLE: Final = Path("services/ui_api/console")
_LEFT_OUT: Final = shutil.ignore_patterns("node_modules", "dist", "schema.ts")


def measure() -> Section:
    """In a copy without anything that was installed or built."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        shutil.copytree(ROOT / _CONSOLE, copy / _CONSOLE, ignore=_LEFT_OUT)
        for file in ("tools/__init__.py", "tools/console.py", "docs/openapi.json"):
            (copy / file).parent.mkdir(parents=True, exist_ok=True)
            if (ROOT / file).exists():
                shutil.copyfile(ROOT / file, copy / file)
        began_s = time.monotonic()
        subprocess.run([sys.executable, "-m", "tools.console", "build"], cwd=copy, check=True)
        first_s, began_s = time.monotonic() - began_s, time.monotonic()
        subprocess.run([sys.executable, "-m", "tools.console", "build"], cwd=copy, check=True)
        again_s = time.monotonic() - began_s
    return section_of(first_s, again_s)


def section_of(first_s: float, again_s: float) -> Section:
    """First time, and when nothing has changed."""
    rows = [("first time", f"{first_s:.1f} s"), ("nothing has changed", f"{again_s:.1f} s")]
    text = (
        f"`python -m tools.console build`, which `make setup` calls, in a copy of the sources. Limit: {LIMIT_S:.0f} s. "
        "Where the machine has no Node, a package of 60 MB is installed before.\n\n" + table(("", "time"), rows)
    )
    return Section(TITLE, text, first_s <= LIMIT_S)

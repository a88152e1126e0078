"""Build and check the console with the machine's Node, or with one from the Python package index where there is none.

usage: python -m tools.console build|check
"""

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

CONSOLE: Final = Path(__file__).parents[1] / "services" / "ui_api" / "console"
DIST: Final = CONSOLE / "dist"
_OPENAPI: Final = Path(__file__).parents[1] / "docs" / "openapi.json"
_BUILT: Final = DIST / "index.html"
# What the newest build was made of, and the packages it was made with.
_BUILT_OF: Final = DIST / ".built-of"
_INSTALLED_OF: Final = CONSOLE / "node_modules" / ".installed-of"
_NODE_LOCK: Final = CONSOLE / "node.lock"
# The oldest with which Vite runs: `engines` in package.json.
_LEAST_NODE: Final = (20, 19)
_SOURCES: Final = ("src", "index.html", "package.json", "package-lock.json", "tsconfig.json", "vite.config.ts")
_PACKAGES: Final = ("package.json", "package-lock.json", ".npmrc")


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code: 0 when all went well."""
    parser = argparse.ArgumentParser(prog="python -m tools.console", description="build or check the console")
    parser.add_argument("what", choices=("build", "check"))
    wanted = parser.parse_args(arguments).what
    try:
        build() if wanted == "build" else check()
    except subprocess.CalledProcessError as error:
        print(f"tools.console: {' '.join(map(str, error.cmd))} ended with {error.returncode}", file=sys.stderr)
        return 1
    return 0


def build() -> None:
    """Build what is served, unless it was built of these very sources."""
    digest = digest_of(_files(_SOURCES), _OPENAPI)
    if _BUILT.is_file() and _is_made_of(_BUILT_OF, digest):
        return
    _npm("run", "--silent", "build")
    _BUILT_OF.write_text(digest + "\n", encoding="ascii")


def check() -> None:
    """Types, lint and tests of the console."""
    _npm("run", "--silent", "check")


def _npm(*words: str) -> None:
    """Run npm in the console's folder, with its packages installed as they are locked."""
    environment = node_environment()
    npm = shutil.which("npm", path=environment["PATH"])
    if npm is None:
        raise SystemExit("tools.console: there is Node but no npm; install it, or remove this Node from the PATH")
    digest = digest_of(_files(_PACKAGES))
    if not _is_made_of(_INSTALLED_OF, digest):
        install = [npm, "ci", "--silent", "--ignore-scripts", "--no-audit", "--no-fund"]
        subprocess.run(install, cwd=CONSOLE, env=environment, check=True)
        _INSTALLED_OF.write_text(digest + "\n", encoding="ascii")
    subprocess.run([npm, *words], cwd=CONSOLE, env=environment, check=True)


def node_environment() -> Mapping[str, str]:
    """Environment in which `node` and `npm` are found; installs them into this Python's environment if need be."""
    node = shutil.which("node")
    if node is not None and is_new_enough(_said(node)) and shutil.which("npm") is not None:
        return dict(os.environ)
    words = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--require-hashes", "-r"]
    subprocess.run([sys.executable, *words, str(_NODE_LOCK)], check=True)
    scripts = Path(sys.executable).parent
    return {**os.environ, "PATH": os.pathsep.join((str(scripts), os.environ.get("PATH", "")))}


def is_new_enough(version: str) -> bool:
    """Whether `node --version` said a version that can build the console."""
    found = re.match(r"v(\d+)\.(\d+)\.", version)
    return found is not None and (int(found[1]), int(found[2])) >= _LEAST_NODE


def digest_of(*groups: Iterator[Path] | Path) -> str:
    """One hash of the names and the content of files."""
    digest = hashlib.sha256()
    for group in groups:
        for file in [group] if isinstance(group, Path) else sorted(group):
            digest.update(f"{file.name}\0{hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


def _files(names: Sequence[str]) -> Iterator[Path]:
    for path in (CONSOLE / name for name in names):
        if path.is_file():
            yield path
            continue
        # Written by the build itself.
        yield from (file for file in path.rglob("*") if file.is_file() and file.name != "schema.ts")


def _is_made_of(mark: Path, digest: str) -> bool:
    return mark.is_file() and mark.read_text(encoding="ascii").strip() == digest


def _said(program: str) -> str:
    return subprocess.run([program, "--version"], capture_output=True, text=True, check=False).stdout


if __name__ == "__main__":
    sys.exit(main())

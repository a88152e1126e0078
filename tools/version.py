"""Makes a version of what is committed: changelog, number, kept schemas, commit and tag, by one command.

usage: python -m tools.version 0.2.0 [--dry-run]

`make version VERSION=0.2.0`, then `make release`. What was under "Unreleased" gets the number and the date, messages'
schemas are kept as those of this release (`tests/contract/messages/releases`), and the tag is `v0.2.0`.
"""

import argparse
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Final

from distalock.version import revision
from shared.errors import ConfigurationError
from shared.messages.schema_files import SCHEMAS

ROOT: Final = Path(__file__).resolve().parents[1]
KEPT_SCHEMAS: Final = ROOT / "tests" / "contract" / "messages" / "releases"
# Part files travel in messages, as text of their own.
PART_SCHEMAS: Final = ROOT / "docs" / "schemas"
_UNRELEASED: Final = "## Unreleased\n"
_NUMBER: Final = re.compile(r"^(\d+)\.(\d+)\.(\d+)$")
_VERSION_LINE: Final = re.compile(r'(?m)^version = "([^"]*)"$')
_UNCOMMITTED: Final = "+"


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the version; 2 when that cannot be done."""
    parser = argparse.ArgumentParser(prog="python -m tools.version", description="make a version: commit and tag")
    parser.add_argument("version", help="its number, such as 0.2.0")
    parser.add_argument("--dry-run", action="store_true", help="say what would be done, and do nothing")
    given = parser.parse_args(arguments)
    try:
        _make(given.version, dry_run=given.dry_run)
    except ConfigurationError as error:
        print(f"version: {error}", file=sys.stderr)
        return 2
    return 0


def _make(version: str, *, dry_run: bool) -> None:
    changed = revision()
    if changed is None or changed.endswith(_UNCOMMITTED):
        raise ConfigurationError(f"the checkout is at {changed}: commit what was changed, then make the version")
    if _git("tag", "--list", f"v{version}"):
        raise ConfigurationError(f"there is a tag v{version} already; take the next number")
    pyproject, changelog = ROOT / "pyproject.toml", ROOT / "CHANGELOG.md"
    new_pyproject = with_version(
        pyproject.read_text(encoding="utf-8"), version, tagged=bool(_git("tag", "--list", "v*"))
    )
    new_changelog = with_release(changelog.read_text(encoding="utf-8"), version, datetime.now(UTC).date())
    if dry_run:
        print(f"version {version} of {changed}: changelog, number, schemas, commit, tag v{version}")
        return
    pyproject.write_text(new_pyproject, encoding="utf-8")
    changelog.write_text(new_changelog, encoding="utf-8")
    keep_schemas(KEPT_SCHEMAS / version)
    _git("add", "--", str(pyproject), str(changelog), str(KEPT_SCHEMAS))
    _git("commit", "--quiet", "--message", f"Version {version}")
    _git("tag", "--annotate", "--message", f"Version {version}", f"v{version}")
    print(f"version {version}: committed and tagged; push both, then make release KEY=FILE OUT=release-{version}")


def with_version(pyproject: str, version: str, *, tagged: bool) -> str:
    """The project's file with another version.

    Parameters
    ----------
    tagged
        Whether the version that it has is a release already: then only a later one may follow.

    Raises
    ------
    ConfigurationError
        When the number is none, or does not follow.
    """
    before, after = _parts(str(tomllib.loads(pyproject)["project"]["version"])), _parts(version)
    if after < before or (tagged and after == before):
        raise ConfigurationError(f"{version} does not follow {'.'.join(map(str, before))}; take a later number")
    return _VERSION_LINE.sub(f'version = "{version}"', pyproject, count=1)


def with_release(changelog: str, version: str, day: date) -> str:
    """The changelog with what was unreleased under a number; raises `ConfigurationError` when nothing was."""
    head, found, rest = changelog.partition(_UNRELEASED)
    entries, _, others = rest.partition("\n## ")
    if not found or not entries.strip():
        raise ConfigurationError("CHANGELOG.md has nothing under '## Unreleased'; a version without a change is none")
    older = f"\n## {others}" if others else ""
    return f"{head}{_UNRELEASED}\n## {version} - {day.isoformat()}\n{entries.strip(chr(10))}\n{older}"


def keep_schemas(folder: Path) -> None:
    """Keep the schemas of all messages and part files as those of a release."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for file in (*SCHEMAS.glob("*.json"), *PART_SCHEMAS.glob("*.json")):
        shutil.copy(file, folder)


def _parts(version: str) -> tuple[int, ...]:
    match = _NUMBER.match(version)
    if match is None:
        raise ConfigurationError(f"{version!r} is no version; three numbers are needed, such as 0.2.0")
    return tuple(map(int, match.groups()))


def _git(*words: str) -> str:
    ended = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise ConfigurationError(f"git {words[0]}: {ended.stderr.strip()}")
    return ended.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())

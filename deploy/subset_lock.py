"""Print the part of `requirements.lock` that one service needs, hashes and all.

There is one lock for the whole project; a container installs only what its service asks for. The lock's ``# via``
comments carry the dependency graph, so no package index and no installed package is needed to cut it.

Usage: ``python deploy/subset_lock.py imaging [--without numba] > imaging.lock``
"""

import argparse
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_NAME = re.compile(r"^([A-Za-z0-9][A-Za-z0-9._-]*)")
_EXTRAS = re.compile(r"^distalock\[([^\]]*)\]")
_REQUIREMENT = re.compile(r"^([A-Za-z0-9][A-Za-z0-9._-]*)==")


def normalised(name: str) -> str:
    """Package name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def wanted_roots(pyproject: str, extra: str) -> set[str]:
    """Direct dependencies of the project with one extra; raises `KeyError` for an unknown extra."""
    project = tomllib.loads(pyproject)["project"]
    requirements = [*project["dependencies"], *_of_extra(project["optional-dependencies"], extra)]
    return {normalised(match[1]) for r in requirements if (match := _NAME.match(r))}


def _of_extra(extras: dict[str, list[str]], extra: str) -> Iterator[str]:
    """What an extra asks for; where it names other extras of the project, what those ask for."""
    for requirement in extras[extra]:
        others = _EXTRAS.match(requirement)
        if others is None:
            yield requirement
        else:
            for other in others[1].split(","):
                yield from _of_extra(extras, other.strip())


def lock_entries(lock: str) -> list[tuple[str, str, set[str]]]:
    """Entries of the lock: (name, text, names of what asks for it)."""
    entries: list[tuple[str, str, set[str]]] = []
    for block in re.split(r"(?m)^(?=[A-Za-z0-9])", lock):
        match = _REQUIREMENT.match(block)
        if match:
            via = re.findall(r"(?m)^    #(?: via|  ) +([A-Za-z0-9][A-Za-z0-9._-]*)", block)
            entries.append((normalised(match[1]), block, {normalised(v) for v in via}))
    return entries


def subset(lock: str, roots: set[str]) -> str:
    """The entries that `roots` need, directly or not, in the lock's order."""
    entries = lock_entries(lock)
    needed = set(roots)
    while True:
        more = {name for name, _, via in entries if via & needed} - needed
        if not more:
            return "".join(text for name, text, _ in entries if name in needed)
        needed |= more


def main() -> str:
    """The lock of an image; ends the process for an extra that there is not."""
    parser = argparse.ArgumentParser(description="the part of requirements.lock that an image needs")
    parser.add_argument("extras", nargs="+", metavar="EXTRA", help="extra of pyproject.toml")
    parser.add_argument("--without", default="", metavar="PACKAGE", help="leave it out, with what it alone asks for")
    given = parser.parse_args()
    pyproject = (ROOT / "pyproject.toml").read_text()
    try:
        wanted = set().union(*(wanted_roots(pyproject, extra) for extra in given.extras))
    except KeyError as error:
        sys.exit(f"no extra named {error} in pyproject.toml")
    return subset((ROOT / "requirements.lock").read_text(), wanted - {normalised(given.without)})


if __name__ == "__main__":
    sys.stdout.write(main())

"""Which tests carry the mark of a requirement, and how those ended that ran."""

import ast
import hashlib
import json
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Final

from shared.errors import InputError
from shared.json_lines import json_lines

ROOT: Final = Path(__file__).resolve().parents[2]
_MARK: Final = "requirement"
_LONG: Final = "long"
# What decides how a test ends.
_SOURCES: Final = ("services", "shared", "simulation", "distalock", "baselines", "benchmarks", "tests")


@dataclass(frozen=True, slots=True)
class MarkedTest:
    """A test function that carries the mark of requirements."""

    file: str
    name: str
    requirements: frozenset[str]
    is_long: bool = False  # `make test` leaves it to `make long-tests`


class Ending(StrEnum):
    """How a test function ended, with all its parameters; the worst first."""

    FAILED = "failed"
    SKIPPED = "skipped"
    PASSED = "passed"
    NOT_RUN = "not run"


@cache
def marked_tests(root: Path = ROOT) -> tuple[MarkedTest, ...]:
    """All tests below `tests` with a mark, read without importing them."""
    files = sorted((root / "tests").rglob("test_*.py"))
    return tuple(test for file in files for test in _marked_in(file, file.relative_to(root).as_posix()))


def _marked_in(file: Path, name: str) -> Iterator[MarkedTest]:
    text = file.read_text(encoding="utf-8")
    if f"mark.{_MARK}" not in text:
        return
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found = frozenset(_requirements(node.decorator_list))
            if found:
                is_long = any(isinstance(d, ast.Attribute) and d.attr == _LONG for d in node.decorator_list)
                yield MarkedTest(name, node.name, found, is_long)


def _requirements(decorators: Iterable[ast.expr]) -> Iterator[str]:
    for one in decorators:
        match one:
            case ast.Call(func=ast.Attribute(attr=attr), args=arguments) if attr == _MARK:
                yield from (a.value for a in arguments if isinstance(a, ast.Constant) and isinstance(a.value, str))


@cache
def digest_of_sources(root: Path = ROOT) -> str:
    """What the tests ran on: a digest of all sources that decide how they end."""
    digest = hashlib.sha256()
    for folder in _SOURCES:
        for file in sorted((root / folder).rglob("*.py")):
            digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Results:
    """How marked tests ended, by name of the function.

    Attributes
    ----------
    outcomes
        Of each test, those of its parameters.
    oldest_s
        Age of the oldest of them.
    sources
        Digests of the sources that they ran on.
    """

    outcomes: Mapping[tuple[str, str], tuple[str, ...]]
    oldest_s: float
    sources: frozenset[str]

    def of(self, test: MarkedTest) -> Ending:
        """How one test ended."""
        outcomes = self.outcomes.get((test.file, test.name), ())
        for ending in (Ending.FAILED, Ending.PASSED, Ending.SKIPPED):
            if ending in outcomes:
                return ending
        return Ending.NOT_RUN


def read_results(folder: Path) -> Results:
    """Results that runs of pytest have left in a folder.

    Raises
    ------
    InputError
        When there are none, or a line is none.
    """
    outcomes: dict[tuple[str, str], list[str]] = {}
    begun, sources = [], set()
    for file in sorted(folder.glob("*.jsonl")):
        for line in json_lines(file.read_text(encoding="utf-8")):
            try:
                row = json.loads(line)
                where, _, name = row["test"].partition("::")
                outcomes.setdefault((where, name.partition("[")[0]), []).append(row["outcome"])
                begun.append(float(row["at_s"]))
                sources.add(str(row["sources"]))
            except (ValueError, KeyError, TypeError):
                raise InputError(f"{file}: a line is no result: {line[:60]}; run `make test` again") from None
    if not begun:
        raise InputError(f"{folder}: no results of tests; run `make test`")
    return Results({k: tuple(v) for k, v in outcomes.items()}, time.time() - min(begun), frozenset(sources))

"""`docs/commands.md` and `docs/benchmarks/README.md` tell of every command, option and benchmark, and of no other."""

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

from distalock.__main__ import COMMANDS
from distalock.arguments import parser_of
from distalock.bench import BENCHMARKS

_DOCS = Path(__file__).parents[3] / "docs"
_PAGE = (_DOCS / "commands.md").read_text(encoding="utf-8")
_BENCHMARKS = (_DOCS / "benchmarks" / "README.md").read_text(encoding="utf-8")
# Said once for all commands, above the table.
_FOR_ALL = {"--help", "--source-to-detector-mm", "--pixel-mm", "--focal-spot-mm", "--invert"}


def _parsers() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Every command that does something, by the words that call it."""

    def below(words: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
        groups = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
        for group in groups:
            for name, sub in group.choices.items():
                yield from below(f"{words} {name}", sub)
        if not groups:
            yield words, parser

    return below("distalock", parser_of(COMMANDS, [command.name for command in COMMANDS]))


def _options(parser: argparse.ArgumentParser) -> set[str]:
    return {o for a in parser._actions for o in a.option_strings if o.startswith("--")} - _FOR_ALL


def test_every_command_is_there_with_its_options_and_no_other() -> None:
    rows = {row.split("`")[1]: row for row in _PAGE.splitlines() if row.startswith("| `distalock ")}
    parsers = dict(_parsers())
    assert len(rows) == len(parsers)
    for words, parser in parsers.items():
        (row,) = (row for call, row in rows.items() if re.match(rf"{words}( [^a-z]|$)", call))
        assert set(re.findall(r"--[a-z][a-z-]+", row)) == _options(parser), words


def test_every_benchmark_is_there_with_a_page_that_is_there() -> None:
    assert re.findall(r"^\| `(\w+)`", _BENCHMARKS, re.MULTILINE) == list(BENCHMARKS)
    for page in re.findall(r"\((\S+\.md)\)", _BENCHMARKS):
        assert (_DOCS / "benchmarks" / page).is_file(), page

"""A part of the page: what was measured, and whether its limits hold."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

HEAD: Final = """# The console in a browser

Made by `distalock bench console [PART ...]`: a Chromium without a window (no graphics card: the processor draws), the
page as the gateway serves it, an installation of real processes with the virtual operating room, all on one machine.
Each part stands by itself and is replaced when it is measured anew. Each limit stands with its part.

"""


@dataclass(frozen=True, slots=True)
class Section:
    """What one part found.

    Attributes
    ----------
    text
        Markdown without its heading.
    holds
        Whether every limit of it holds.
    """

    title: str
    text: str
    holds: bool


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown."""
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"


def with_sections(page: Path, new: Mapping[str, Section], order: Sequence[str]) -> str:
    """The page's text with some sections new; the others stay as they are."""
    text = page.read_text(encoding="utf-8") if page.exists() else ""
    parts = re.split(r"^(?=## )", text, flags=re.MULTILINE)[1:]
    known = {part.split("\n", 1)[0].removeprefix("## "): part.rstrip() + "\n" for part in parts}
    known |= {one.title: f"## {one.title}\n\n{one.text.rstrip()}\n" for one in new.values()}
    return HEAD + "\n".join(known[title] for title in order if title in known)

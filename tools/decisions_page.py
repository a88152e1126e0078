"""Print `docs/decisions/README.md`: the index of all decision records, by topic.

A record's file name has its number. Its first line is its title; the line `Topic: ...` below it places it in the index.
"""

import re
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final

FOLDER: Final = Path(__file__).parents[1] / "docs" / "decisions"
TOPICS: Final = (
    "localisation",
    "imaging",
    "wires, several images, guidance",
    "robot and motion",
    "bus and keys",
    "procedure and record",
    "console and client",
    "faults, checks and risk",
    "code and packaging",
)
SUMMARY_FROM_WORDS: Final = 600

_RECORD = re.compile(r"# (?P<number>\d+)\. (?P<title>.+)\n\nTopic: (?P<topic>.+)\n\n(?P<text>(?s:.+))")
_INTRODUCTION = f"""# Decision records

Why distalock is built as it is. Each record has the question, what was tried on real code or data, what was chosen, and
what it costs; one of more than {SUMMARY_FROM_WORDS} words begins with a summary. Numbers that are missing were never
given. A new record is a file `00NN-title.md` here that begins like the others; `make generated` adds it to this list.
"""


@dataclass(frozen=True, slots=True)
class Record:
    """One decision record.

    Attributes
    ----------
    file
        Name of its file.
    topic
        One of `TOPICS`.
    text
        What follows title and topic.
    """

    file: str
    number: int
    title: str
    topic: str
    text: str


def decisions_page() -> str:
    """The index as Markdown."""
    by_topic = sorted(records(), key=lambda record: (TOPICS.index(record.topic), record.number))
    sections = (_section(topic, tuple(group)) for topic, group in groupby(by_topic, key=lambda record: record.topic))
    return "\n".join((_INTRODUCTION, *sections))


def records(folder: Path = FOLDER) -> tuple[Record, ...]:
    """All records of a folder, in the order of their numbers.

    Raises
    ------
    ValueError
        A file does not begin as a record does, has another number than its name, or a topic that the index lacks.
    """
    return tuple(_record(file) for file in sorted(folder.glob("[0-9]*.md")))


def _record(file: Path) -> Record:
    found = _RECORD.match(file.read_text(encoding="utf-8"))
    if found is None:
        raise ValueError(f"{file.name} does not begin with a title, '# 7. ...', and a topic, 'Topic: ...'")
    number, topic = int(found["number"]), found["topic"]
    if not file.name.startswith(f"{number:04}-"):
        raise ValueError(f"{file.name} has the title of number {number}")
    if topic not in TOPICS:
        raise ValueError(f"{file.name} has the topic {topic!r}; topics are {', '.join(map(repr, TOPICS))}")
    return Record(file.name, number, found["title"], topic, found["text"])


def _section(topic: str, group: tuple[Record, ...]) -> str:
    lines = (f"- [{record.number}. {record.title}]({record.file})" for record in group)
    return "\n".join((f"## {topic[0].upper()}{topic[1:]}", "", *lines, ""))

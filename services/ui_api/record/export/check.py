"""Check this folder: python3 check.py. It needs nothing but Python.

Every file against SHA256SUMS, the events against the hash chain, documents and images against the hashes by which
events name them. All of that lies in this folder, and so does this program: whoever rewrites everything consistently is
found only by what was handed over another way. Give it with --sums, --events and --head. README.md states what is
proven by each.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Json = dict[str, Any]  # as it was read: what is not of the shape expected is reported in `main`
DOCUMENT_KEYS = frozenset(
    {"document_sha256", "overlay_sha256", "header_sha256", "plan_sha256", "page_sha256", "sha256"}
)
EVENT_KEYS = ("sequence", "at_ns", "case_id", "who", "why", "kind", "data")
CHAIN_KEYS = ("sequence", "previous_sha256", "sha256")


@dataclass(frozen=True)
class Export:
    """What was read: events of the case, and number and hashes of every event of the record.

    `links` is None when the export is de-identified: hashes are over what was removed.
    """

    folder: Path
    events: list[Json]
    links: list[Json] | None


def sha256_of(file: Path) -> str:
    """Hash of a file's content."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def lines_of(file: Path) -> list[str]:
    """Lines end with a line feed alone: a text may hold other characters at which Python's `splitlines` splits."""
    return [line for line in file.read_bytes().decode("utf-8").split("\n") if line]


def json_lines(file: Path, keys: Sequence[str]) -> list[Json]:
    """Objects of a file, one a line; raises `ValueError` when a line is none, or lacks a key."""
    objects = []
    for number, line in enumerate(lines_of(file), 1):
        try:
            one = json.loads(line)
        except ValueError:
            one = None
        lacking = [key for key in keys if key not in one] if isinstance(one, dict) else ["everything: it is no object"]
        if lacking:
            raise ValueError(f"{file.name}: line {number} lacks {', '.join(lacking)}")
        objects.append(one)
    return objects


def read_export(folder: Path) -> Export:
    """Events and chain; raises `ValueError` where they cannot be read, or the chain is missing."""
    events = json_lines(folder / "events.jsonl", EVENT_KEYS)
    if not events:
        raise ValueError("events.jsonl has no event")
    if (folder / "chain.jsonl").is_file():
        links = json_lines(folder / "chain.jsonl", CHAIN_KEYS)
        return Export(folder, json_lines(folder / "events.jsonl", EVENT_KEYS + CHAIN_KEYS), links)
    if any(key in event for event in events for key in ("previous_sha256", "sha256")):
        raise ValueError("chain.jsonl is missing: only a de-identified export, whose events have no hashes, has none")
    return Export(folder, events, None)


def canonical(value: object, *, ascii_only: bool) -> str:
    """JSON as it was hashed: sorted keys, no spaces."""
    return json.dumps(value, ensure_ascii=ascii_only, sort_keys=True, separators=(",", ":"))


def event_sha256(event: Json) -> str:
    """Hash of an event by its content and the hash before it."""
    before = [event[key] for key in ("previous_sha256", "sequence", "at_ns", "case_id", "who", "why", "kind")]
    content = [*before, canonical(event["data"], ascii_only=False)]
    return hashlib.sha256(canonical(content, ascii_only=True).encode()).hexdigest()


def changed_files(folder: Path) -> Iterator[str]:
    """What does not agree with SHA256SUMS."""
    sums = [line.split("  ", 1) for line in lines_of(folder / "SHA256SUMS")]
    for expected, name in sums:
        if not (folder / name).is_file():
            yield f"{name} is missing"
        elif sha256_of(folder / name) != expected:
            yield f"{name} was changed"
    there = {file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()}
    for name in sorted(there - {name for _, name in sums} - {"SHA256SUMS"}):
        yield f"{name} is not named in SHA256SUMS"


def broken_links(links: Sequence[Json]) -> Iterator[str]:
    """Where the chain is none."""
    previous = "0" * 64
    for number, link in enumerate(links, 1):
        if (link["sequence"], link["previous_sha256"]) != (number, previous):
            yield f"chain.jsonl: event {number} does not follow the one before it"
        previous = link["sha256"]


def changed_events(events: Sequence[Json], links: Sequence[Json]) -> Iterator[str]:
    """Which events are not those of the chain, in its order, or of another case."""
    by_number = {link["sequence"]: link for link in links}
    last = 0
    for event in events:
        number, link = event["sequence"], by_number.get(event["sequence"])
        if link is None:
            yield f"events.jsonl: event {number} is not in chain.jsonl"
            continue
        if number <= last:
            yield f"events.jsonl: event {number} stands after event {last}"
        if event["case_id"] != events[0]["case_id"]:
            yield f"events.jsonl: event {number} is of case {event['case_id']}, the first of {events[0]['case_id']}"
        if not event_sha256(event) == event["sha256"] == link["sha256"]:
            yield f"events.jsonl: event {number} was changed: its content does not give its hash"
        last = number


def documents_named(value: object) -> Iterator[str]:
    """Hashes of the documents that an event's data names, at any depth."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key in DOCUMENT_KEYS and isinstance(inner, str):
                yield inner
            else:
                yield from documents_named(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from documents_named(inner)


def changed_documents(export: Export) -> Iterator[str]:
    """Which documents are not what events name."""
    named = {sha256 for event in export.events for sha256 in documents_named(event["data"])}
    files = sorted((export.folder / "documents").glob("*"))
    for sha256 in sorted(named - {file.name.split(".")[0] for file in files}):
        yield f"document {sha256}, which an event names, is missing"
    for file in files:
        if file.name.split(".")[0] not in named:
            yield f"documents/{file.name}: no event names it"
        elif sha256_of(file) != file.name.split(".")[0]:
            yield f"documents/{file.name} was changed: its content does not give the hash by which events name it"


def images_named(events: Sequence[Json]) -> dict[str, str]:
    """Name of the file of each image that was received, in the order of receipt, and its hash."""
    received = [event["data"]["image_sha256"] for event in events if event["kind"] == "image_received"]
    return {f"{number:03}-{sha256[:12]}.dcm": sha256 for number, sha256 in enumerate(dict.fromkeys(received), 1)}


def missing_images(export: Export) -> list[str]:
    """Hashes of the images that were received and have no file here."""
    named = images_named(export.events)
    return [sha256 for name, sha256 in named.items() if not (export.folder / "images" / name).is_file()]


def changed_images(export: Export) -> Iterator[str]:
    """Which images are not what events name, or are missing without a word in README.md."""
    named = images_named(export.events)
    for file in sorted((export.folder / "images").glob("*.dcm")):
        if file.name not in named:
            yield f"images/{file.name}: no event names it at this place"
        elif sha256_of(file) != named[file.name]:
            yield f"images/{file.name} was changed: its content does not give the hash by which events name it"
    explained = (export.folder / "README.md").read_text(encoding="utf-8")
    for sha256 in missing_images(export):
        if sha256 not in explained:
            yield f"image {sha256}, which an event names, is missing, and README.md does not state why"


def findings_of(given: argparse.Namespace) -> Iterator[str]:
    """Everything that does not hold, one sentence each."""
    yield from changed_files(given.folder)
    export = read_export(given.folder)
    if export.links is not None:
        yield from broken_links(export.links)
        yield from changed_events(export.events, export.links)
        yield from changed_documents(export)
        yield from changed_images(export)
    for name, found, expected in (
        ("SHA-256 of SHA256SUMS", sha256_of(given.folder / "SHA256SUMS"), given.sums),
        ("number of events of the case", len(export.events), given.events),
        ("head of the record", export.links[-1]["sha256"] if export.links else "not in this export", given.head),
    ):
        if expected is not None and found != expected:
            yield f"{name}: {found}; expected was {expected}"


def covered_by_head(export: Export) -> int:
    """How many events, the last of the record, are the case's: what stands before others is bound by hashes alone."""
    numbers = {event["sequence"] for event in export.events}
    last = len(export.links or ())
    return next((n for n in range(last) if last - n not in numbers), last)


def report_of(given: argparse.Namespace) -> Iterator[str]:
    """What holds, and what somebody has to compare."""
    export = read_export(given.folder)
    yield "all files are as SHA256SUMS names them"
    if export.links is None:
        yield "de-identified: there is no chain; events, documents and images were compared with SHA256SUMS alone"
    else:
        yield "events are as the chain names them, documents and images as the events name them"
        for sha256 in missing_images(export):
            yield f"not here, README.md states why: image {sha256}"
    yield f"SHA-256 of SHA256SUMS: {sha256_of(given.folder / 'SHA256SUMS')}{compared(given.sums)}"
    yield f"events of the case: {len(export.events)}{compared(given.events)}"
    if export.links is not None:
        own = f"with their content it covers the last {covered_by_head(export)} of the case"
        yield f"head of the record: {export.links[-1]['sha256']}{compared(given.head)}; {own}"
    if given.sums is None:
        yield "compare these with what you were given another way: until then nothing shows that all was not rewritten"


def compared(expected: object) -> str:
    """Whether somebody has given what to expect."""
    return " (not compared)" if expected is None else " (as expected)"


def main() -> int:
    """Exit code: 0 when all holds, 1 when something does not, 2 for arguments that are none."""
    parser = argparse.ArgumentParser(description="Check an export. README.md states what is proven by each option.")
    here = Path(__file__).resolve().parent
    parser.add_argument("folder", nargs="?", type=Path, default=here, help="the folder; default: where this program is")
    parser.add_argument("--sums", type=str.lower, metavar="SHA256", help="expected hash of the file SHA256SUMS")
    parser.add_argument("--events", type=int, metavar="NUMBER", help="expected number of events of the case")
    parser.add_argument("--head", type=str.lower, metavar="SHA256", help="expected hash of the last event")
    given = parser.parse_args()
    findings: list[str] = []
    try:
        findings.extend(findings_of(given))
        lines = findings or list(report_of(given))
    except OSError as error:
        lines = findings = [*findings, f"{Path(str(error.filename)).name}: {error.strerror}"]
    except ValueError as error:
        lines = findings = [*findings, str(error)]
    except (KeyError, TypeError) as error:
        lines = findings = [*findings, f"events.jsonl or chain.jsonl has a value of another kind: {error}"]
    sys.stdout.write("".join(line + "\n" for line in lines))
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())

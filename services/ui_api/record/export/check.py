"""Check this folder: python3 check.py. It needs nothing but Python.

Every file against SHA256SUMS; and, where there is a chain.jsonl, that it is one chain and that every event of the case
stands in it with its content.
"""

import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path


def canonical(value: object, *, ascii_only: bool) -> str:
    """JSON as it was hashed: sorted keys, no spaces."""
    return json.dumps(value, ensure_ascii=ascii_only, sort_keys=True, separators=(",", ":"))


def changed_files(folder: Path) -> Iterator[str]:
    """What does not agree with SHA256SUMS."""
    for line in (folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines():
        expected, name = line.split("  ", 1)
        if not (folder / name).is_file():
            yield f"{name} is missing"
        elif hashlib.sha256((folder / name).read_bytes()).hexdigest() != expected:
            yield f"{name} was changed"


def broken_links(folder: Path) -> Iterator[str]:
    """What does not agree with the chain."""
    if not (folder / "chain.jsonl").is_file():
        return
    links = [json.loads(line) for line in (folder / "chain.jsonl").read_text(encoding="utf-8").splitlines()]
    previous = "0" * 64
    for number, link in enumerate(links, 1):
        if (link["sequence"], link["previous_sha256"]) != (number, previous):
            yield f"chain.jsonl: event {number} does not follow the one before it"
        previous = link["sha256"]
    for line in (folder / "events.jsonl").read_text(encoding="utf-8").splitlines():
        e = json.loads(line)
        data = canonical(e["data"], ascii_only=False)
        content = [e["previous_sha256"], e["sequence"], e["at_ns"], e["case_id"], e["who"], e["why"], e["kind"], data]
        found = hashlib.sha256(canonical(content, ascii_only=True).encode()).hexdigest()
        if not found == e["sha256"] == links[e["sequence"] - 1]["sha256"]:
            yield f"events.jsonl: event {e['sequence']} was changed: its content does not give its hash"


def main() -> int:
    """Exit code: 0 when all holds."""
    folder = Path(__file__).resolve().parent
    findings = [*changed_files(folder), *broken_links(folder)]
    for finding in findings or ["all files are as they were exported"]:
        sys.stdout.write(finding + "\n")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())

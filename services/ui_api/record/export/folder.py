"""Write a case as a folder, with a page that explains every file in it."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from services.ui_api.record.durable_files import require_empty, write_durably
from services.ui_api.record.export.content import CaseContent, Json, png_of_dicom
from services.ui_api.record.export.report import report_html
from shared.parts.files import sha256_of

_CHECK: Final = Path(__file__).with_name("check.py")
_ENDINGS: Final = {"application/json": "json", "image/png": "png", "text/html": "html"}
_EXPLAINED: Final = {
    "report.html": "the case for people: set-up, images with what was found in them, what happened when",
    "events.jsonl": "every event of the case, one JSON object a line: number, time, who, why, kind, data",
    "documents": "what the events name: part files, calibrations, localisations, plans, verifications, overlays; each "
    "under the hash by which events name it",
    "images": "the X-ray images in the order of receipt: as stored (DICOM), and as a picture for people (PNG)",
    "chain.jsonl": "number and hashes of every event of the record, also of other cases, whose content is not here",
    "check.py": "checks all of this: `python3 check.py`",
    "SHA256SUMS": "hash of every file: `sha256sum --check SHA256SUMS`",
}
_CHAIN: Final = """
## How the chain is checked
Each event carries the hash of the one before it. The hash of an event is the SHA-256 of a JSON list: hash of the event
before, number, time in nanoseconds since 1970, case, who, why, kind, and its data as JSON text with sorted keys and
without spaces. Whoever has the hash of the record's last event (`distalock record verify` prints it, anchors keep it)
knows that nothing that stands here was changed.
"""


@dataclass(frozen=True, slots=True)
class WrittenFolder:
    """What was written: number of files, and what is missing, one sentence each."""

    files: int
    missing: tuple[str, ...]


@dataclass(slots=True)
class _Files:
    """Files of the folder, by name, before they are written."""

    content: dict[str, bytes] = field(default_factory=dict)

    def put(self, name: str, content: bytes) -> str:
        self.content[name] = content
        return name


def write_folder(case: CaseContent, folder: Path, notes: tuple[str, ...] = ()) -> WrittenFolder:
    """Write a case into a new or empty folder.

    Parameters
    ----------
    notes
        What the reader must know first, one sentence each.

    Raises
    ------
    InputError
        When the folder is not empty.
    """
    require_empty(folder, "an export")
    files = _Files()
    pictures = _put_documents(case, files) | _put_images(case, files)
    files.put("events.jsonl", _lines(case.events))
    if case.chain is not None:
        files.put("chain.jsonl", _lines(case.chain))
    files.put("check.py", _CHECK.read_bytes())
    files.put("report.html", report_html(case, pictures, notes).encode())
    missing = tuple(f"image {image.sha256}: {image.note}" for image in case.images if image.note)
    files.put("README.md", _readme(case, files, notes, missing).encode())
    sums = "".join(f"{sha256_of(content)}  {name}\n" for name, content in sorted(files.content.items()))
    for name, content in files.content.items():
        write_durably(folder / name, (content,))
    write_durably(folder / "SHA256SUMS", (sums.encode(),))
    return WrittenFolder(len(files.content) + 1, missing)


def _put_documents(case: CaseContent, files: _Files) -> dict[str, str]:
    pictures = {}
    for document in case.documents:
        ending = _ENDINGS.get(document.media_type, "bin")
        name = files.put(f"documents/{document.sha256}.{ending}", document.content)
        if ending == "png":
            pictures[document.sha256] = name
    return pictures


def _put_images(case: CaseContent, files: _Files) -> dict[str, str]:
    pictures = {}
    for number, image in enumerate(case.images, 1):
        if image.dicom is None:
            continue
        name = files.put(f"images/{number:03}-{image.sha256[:12]}.dcm", image.dicom)
        if (png := png_of_dicom(image.dicom)) is not None:
            pictures[image.sha256] = files.put(name.removesuffix("dcm") + "png", png)
    return pictures


def _readme(case: CaseContent, files: _Files, notes: tuple[str, ...], missing: tuple[str, ...]) -> str:
    there = {name.split("/")[0] for name in files.content} | {"SHA256SUMS"}
    rows = [f"| `{name}` | {about} |" for name, about in _EXPLAINED.items() if name in there]
    lines = [
        f"# Case {case.case_id}",
        "",
        "Written by distalock, research software that aims a drill guide at the distal holes of an intramedullary nail",
        "from X-ray images. Not a medical device. Begin with `report.html`.",
        *(f"\n{note}" for note in notes),
        "",
        "| file or folder | what it is |",
        "|---|---|",
        *rows,
    ]
    if missing:
        lines += ["", "## What is missing", *(f"- {sentence}" for sentence in missing)]
    return "\n".join(lines) + "\n" + (_CHAIN if case.chain is not None else "")


def _lines(objects: tuple[Json, ...]) -> bytes:
    return "".join(json.dumps(one, ensure_ascii=False) + "\n" for one in objects).encode()

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
    "check.py": "checks this folder: `python3 check.py`; what that proves stands below",
    "SHA256SUMS": "hash of every file: `sha256sum --check SHA256SUMS`",
}
_CHAIN: Final = """
## How the chain is checked
Each event carries the hash of the one before it. The hash of an event is the SHA-256 of a JSON list: hash of the event
before, number, time in nanoseconds since 1970, case, who, why, kind, and its data as JSON text with sorted keys and
without spaces. `check.py` computes it anew for every event of this case, and compares documents and images (DICOM) with
the hashes by which events name them. `report.html` and pictures of images (PNG) are made from these for people; only
`SHA256SUMS` is over them.

## What the check proves, and what it does not
`check.py` finds damage, and changes by somebody who did not compute every hash anew. It does not find somebody who
rewrote this whole folder consistently, or `check.py` itself. For that, use a `check.py` from distalock's source
(`services/ui_api/record/export/`), as `python3 check.py FOLDER`, and give it what whoever exported the case has sent
you another way (`distalock record export` prints it):

- `--sums SHA256`, the hash of `SHA256SUMS`: proves that every file is as it was exported. The others prove less:
- `--events NUMBER`, how many events the case has: shows that one was taken out or put in.
- `--head SHA256`, the hash of the record's last event when the case was exported: proves the last events of the case,
  up to the nearest event that is not of this case. Of such an event only the hash is here, which nobody can compute
  anew: an event before it can be changed, and the chain with it, and the head stays. `check.py` prints how many events
  the head covers.

Whoever has the record can export the case again: `events.jsonl`, documents and images are then the same byte for byte.
Nothing here proves that what was recorded is true, or that its time is right: it is that of the gateway's clock.
"""
_NO_CHAIN: Final = """
## What the check proves, and what it does not
`check.py` compares every file with `SHA256SUMS`, and nothing more: there is no chain. Whoever changes a file and
rewrites `SHA256SUMS` is found only with the hash of `SHA256SUMS`, sent another way (`distalock record anonymise` prints
it): `python3 check.py FOLDER --sums SHA256`, with a `check.py` from distalock's source
(`services/ui_api/record/export/`).
"""


@dataclass(frozen=True, slots=True)
class WrittenFolder:
    """What was written.

    Attributes
    ----------
    files
        Number of files.
    missing
        What is missing, one sentence each.
    sums_sha256
        Hash of `SHA256SUMS`: with it every file can be proven to be as it was written.
    events
        How many events the case has.
    head_sha256
        Hash of the record's last event; None without a chain.
    """

    files: int
    missing: tuple[str, ...]
    sums_sha256: str
    events: int
    head_sha256: str | None


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
    sums = "".join(f"{sha256_of(content)}  {name}\n" for name, content in sorted(files.content.items())).encode()
    for name, content in files.content.items():
        write_durably(folder / name, (content,))
    write_durably(folder / "SHA256SUMS", (sums,))
    head = str(case.chain[-1]["sha256"]) if case.chain else None
    return WrittenFolder(len(files.content) + 1, missing, sha256_of(sums), len(case.events), head)


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
    return "\n".join(lines) + "\n" + (_CHAIN if case.chain is not None else _NO_CHAIN)


def _lines(objects: tuple[Json, ...]) -> bytes:
    return "".join(json.dumps(one, ensure_ascii=False) + "\n" for one in objects).encode()

"""The case as a page for people: set-up, images, what happened when. Without scripts and outside addresses."""

import json
from collections.abc import Iterable, Mapping
from html import escape
from typing import Final

from services.ui_api.record.export.content import CaseContent, Json

_STYLE: Final = (
    "body{font:15px/1.5 sans-serif;max-width:70em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse;width:100%}th,td{text-align:left;vertical-align:top;padding:.25em .6em;"
    "border-bottom:1px solid #ccc}figure{display:inline-block;margin:.5em;width:20em}img{max-width:100%}"
    "code{font-size:85%;overflow-wrap:anywhere}"
)
_SETUP: Final = ("side", "bone", "mount", "head_extension_mm", "drill_diameter_mm")
_PARTS: Final = ("ring", "guide", "nail", "hexapod")


def report_html(case: CaseContent, pictures: Mapping[str, str], notes: Iterable[str]) -> str:
    """The page.

    Parameters
    ----------
    pictures
        Hash of an image or an overlay to the name of its picture in the folder.
    notes
        What the reader must know first, one sentence each.
    """
    title = f"Case {case.case_id}"
    body = [
        f"<h1>{escape(title)}</h1>",
        *(f"<p>{escape(note)}</p>" for note in notes),
        "<h2>Set-up</h2>",
        _table(("", ""), _setup_rows(case.events)),
        "<h2>Images</h2>",
        *(_figure(case, image.sha256, image.note, pictures) for image in case.images),
        "<h2>What happened</h2>",
        _table(("", "time", "who", "what", "details"), (_event_row(event) for event in case.events)),
    ]
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style>'
    return f"<!doctype html>\n<html lang=en><head>{head}</head><body>\n" + "\n".join(body) + "\n</body></html>\n"


def _setup_rows(events: tuple[Json, ...]) -> list[tuple[str, ...]]:
    """The newest set-up; earlier ones stand in what happened."""
    setups = [data["setup"] for event in events if isinstance(data := event["data"], dict) and "setup" in data]
    newest = setups[-1] if setups else {}
    if not isinstance(newest, dict):
        return []
    rows: list[tuple[str, ...]] = [(key.replace("_", " "), str(newest.get(key, ""))) for key in _SETUP]
    for key in _PARTS:
        part = newest.get(key)
        if isinstance(part, dict):
            rows.append((key, f"{part.get('name', '')} (SHA-256 {part.get('sha256', '')})"))
    return rows


def _figure(case: CaseContent, sha256: str, note: str, pictures: Mapping[str, str]) -> str:
    shown = [pictures[name] for name in (sha256, *_overlays(case.events, sha256)) if name in pictures]
    images = "".join(f'<img src="{escape(name, quote=True)}" alt="">' for name in shown)
    return f"<figure>{images}<figcaption><code>{sha256}</code> {escape(note)}</figcaption></figure>"


def _overlays(events: tuple[Json, ...], sha256: str) -> list[str]:
    """Hashes of what was drawn on an image."""
    found = [e["data"] for e in events if isinstance(e["data"], dict) and e["data"].get("image_sha256") == sha256]
    return [str(d["overlay_sha256"]) for d in found if isinstance(d, dict) and d.get("overlay_sha256")]


def _event_row(event: Json) -> tuple[str, ...]:
    why = f"{event['why']} " if event["why"] else ""
    details = why + json.dumps(event["data"], ensure_ascii=False)
    kind = str(event["kind"]).replace("_", " ")
    return (str(event["sequence"]), str(event["at"]), str(event["who"]), kind, details)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    def row(cells: tuple[str, ...], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    return "<table>" + row(head, "th") + "".join(row(cells, "td") for cells in rows) + "</table>"

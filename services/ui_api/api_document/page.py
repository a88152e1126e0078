"""The OpenAPI document as one HTML page for people, without a script and without another address. Pure."""

import base64
import hashlib
import html
import json
from collections.abc import Mapping
from typing import Final

from services.ui_api.api_document.operations import JsonObject, Operation, operations

STYLE: Final = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1a2026; background: #fff; }
body { max-width: 70rem; margin: 0 auto; padding: 1rem; }
nav a { margin-right: 1rem; }
details { border: 1px solid #c6ced6; border-radius: 4px; margin: 0.4rem 0; padding: 0.2rem 0.8rem; }
summary { cursor: pointer; }
summary b { display: inline-block; width: 4.5rem; }
code, pre { font: 14px/1.4 ui-monospace, monospace; }
pre { overflow-x: auto; background: #f2f5f7; padding: 0.6rem; }
td, th { text-align: left; vertical-align: top; padding: 0.1rem 1rem 0.1rem 0; }
@media (prefers-color-scheme: dark) {
  body { color: #e3e8ed; background: #14181c; }
  pre { background: #1f262c; }
  a { color: #8ab8ff; }
}
"""
_DIGEST: Final = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()
# The page's own style, and nothing else: no script, no picture, no other address.
POLICY: Final = (
    f"default-src 'none'; style-src 'sha256-{_DIGEST}'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def page_of(document: JsonObject) -> str:
    """The page of a document: operations by tag, each with who may, what it takes, an example, and what comes next."""
    by_tag: dict[str, list[Operation]] = {}
    for operation in operations(document):
        tags = operation.described.get("tags") or ["other"]
        assert isinstance(tags, list)
        by_tag.setdefault(str(tags[0]), []).append(operation)
    examples = _object(_object(document["components"]).get("examples", {}))
    info = _object(document["info"])
    places = "".join(f'<a href="#{_anchor(tag)}">{html.escape(tag)}</a>' for tag in by_tag)
    sections = "".join(_section(tag, found, examples) for tag, found in by_tag.items())
    title, says = html.escape(str(info["title"])), html.escape(str(info["summary"]))
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}: interface</title>'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head><body>'
        f'<h1>{title}: interface</h1><p>{says}</p><p>The document itself: <a href="/openapi.json">openapi.json</a>.</p>'
        f"<nav>{places}</nav>{sections}</body></html>"
    )


def _section(tag: str, found: list[Operation], examples: JsonObject) -> str:
    return f'<h2 id="{_anchor(tag)}">{html.escape(tag)}</h2>' + "".join(_operation(one, examples) for one in found)


def _operation(operation: Operation, examples: JsonObject) -> str:
    described = operation.described
    says = html.escape(str(described.get("description", ""))).replace("\n\n", "</p><p>")
    parts = [
        f"<p>{says}</p>",
        f"<p>Action: <code>{html.escape(str(described.get('x-distalock-action', '')))}</code></p>",
        _parameters(described),
        _example("Body", examples.get(f"{operation.name}_body")),
        _answers(operation),
        _example("Answer", examples.get(operation.name)),
        _links(operation),
    ]
    method, path = operation.method.upper(), html.escape(operation.path)
    head = f"<summary><b>{method}</b> <code>{path}</code></summary>"
    return f'<details id="{operation.name}">{head}{"".join(parts)}</details>'


def _parameters(described: JsonObject) -> str:
    parameters = described.get("parameters", [])
    assert isinstance(parameters, list)
    rows = "".join(
        f"<tr><td><code>{html.escape(one['name'])}</code></td><td>{one['in']}</td>"
        f"<td>{'needed' if one['required'] else ''}</td><td>{html.escape(str(one.get('description', '')))}</td></tr>"
        for one in parameters
    )
    return f"<table>{rows}</table>" if rows else ""


def _answers(operation: Operation) -> str:
    rows = []
    for status, answer in operation.good_answers.items():
        headers = ", ".join(_object(answer.get("headers", {}))) or "none of its own"
        rows.append(f"<p>{status}: {html.escape(str(answer.get('description', '')))}; headers: {headers}</p>")
    return "".join(rows)


def _example(name: str, example: object) -> str:
    if not isinstance(example, dict):
        return ""
    value = example["value"]
    text = value if isinstance(value, str) else json.dumps(value, indent=1, ensure_ascii=False)
    return f"<p>{name}, for example:</p><pre>{html.escape(text)}</pre>"


def _links(operation: Operation) -> str:
    links: dict[str, object] = {}
    for answer in operation.good_answers.values():
        links |= _object(answer.get("links", {}))
    rows = "".join(
        f'<li><a href="#{target}">{target}</a>: {html.escape(str(_object(link)["description"]))}</li>'
        for target, link in links.items()
    )
    return f"<p>Leads to:</p><ul>{rows}</ul>" if rows else ""


def _anchor(tag: str) -> str:
    return "tag-" + tag.replace(" ", "-")


def _object(value: object) -> JsonObject:
    assert isinstance(value, Mapping)
    return dict(value)

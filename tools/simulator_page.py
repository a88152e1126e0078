"""`docs/simulator-api.md`: the virtual operating room's own HTTP API, printed from its OpenAPI document."""

import inspect
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, cast

from simulation.control.api import control_app
from simulation.controller.faults import Fault
from simulation.controller.virtual_controller import VirtualController
from simulation.room.foot_pedal import FootPedal
from simulation.room.operating_room import OperatingRoom

_CONTROL: Final = Path(__file__).parents[1] / "simulation" / "control"
_HEAD: Final = """# The virtual operating room's own API

What people's hands do in a simulation: step on the pedal, turn the C-arm, push wires, drill; and what nobody in a real
room knows: the truth. `distalock up --simulate` serves it at `http://127.0.0.1:8900` (`--control-port`), `distalock
virtual-or` by itself. It is no part of the product: no service calls it, and there is no login. Its OpenAPI document is
at `/openapi.json`, a page to try it at `/docs`. This page is printed from that document by `make generated`, and a test
runs the commands below.

## A first session

```sh
curl http://127.0.0.1:8900/scenario
curl -X POST http://127.0.0.1:8900/shots
curl --json '{"about_image_x_deg": 2.0, "about_image_y_deg": -1.0}' http://127.0.0.1:8900/c-arm/turn
curl -X POST http://127.0.0.1:8900/wires
curl -X DELETE http://127.0.0.1:8900/wires
curl --json '{"hole_id": "distal"}' http://127.0.0.1:8900/drills
curl --json '{"kind": "low_dose", "dose_factor": 0.2}' http://127.0.0.1:8900/faults
curl --json '{"kind": "controller", "name": "slow_reply"}' http://127.0.0.1:8900/faults
curl -X DELETE http://127.0.0.1:8900/faults/controller/slow_reply
curl -X DELETE http://127.0.0.1:8900/faults
curl http://127.0.0.1:8900/truth
```

`case` in the scenario is the body of `POST /api/v1/cases` at the gateway ([rest.md](rest.md)).

## Operations

"""
_REFUSALS: Final = """
## Refusals

Problem documents (RFC 9457) with `code` and a sentence in `detail`:

"""
_REFUSAL: Final = re.compile(r'(?:Problem|problem_response)\((\d{3}), "(\w+)"|(\d{3}): "(\w+)"')
_FAULT_LINE: Final = re.compile(r"^\s*(`[A-Z_`, ]+`): (.*)$")
_ELSEWHERE: Final = ((502, "image_not_delivered"),)
_BOUNDS: Final = (
    ("exclusiveMinimum", "> {}"),
    ("minimum", "at least {}"),
    ("exclusiveMaximum", "< {}"),
    ("maximum", "at most {}"),
    ("minLength", "length at least {}"),
    ("maxLength", "length at most {}"),
)
JsonObject = Mapping[str, Any]


def simulator_page() -> str:
    """The page as it must be."""
    document = _document()
    rows = "".join(_operations(document))
    bodies = "".join(_bodies(document["components"]["schemas"]))
    return (
        f"{_HEAD}| | | body | answer |\n|---|---|---|---|\n{rows}\n## Bodies\n{bodies}\n## Faults of the controller\n\n"
        f"| `name` | |\n|---|---|\n{''.join(_controller_faults())}"
        f"{_REFUSALS}| status | code |\n|---|---|\n{''.join(_refusals())}"
    )


@cache
def _document() -> JsonObject:
    # Its routes are asked for what they are, and never called.
    nothing = cast("OperatingRoom", None)
    app = control_app(nothing, cast("FootPedal", None), cast("VirtualController", None))
    return app.openapi()


def _operations(document: JsonObject) -> Iterator[str]:
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            body = operation.get("requestBody")
            status, answer = next(iter(operation["responses"].items()))
            taken = "" if body is None else _type_of(_json_schema(body))
            optional = "" if body is None or body.get("required") else ", may be left out"
            given = _json_schema(answer)
            yield (
                f"| `{method.upper()} {path}` | {operation['description']} | {taken}{optional} "
                f"| {status}{'' if given is None else ' ' + _type_of(given)} |\n"
            )


def _json_schema(part: JsonObject) -> JsonObject | None:
    """The schema of a body in JSON; None of another one, and of none."""
    found: JsonObject | None = part.get("content", {}).get("application/json", {}).get("schema")
    return found or None


def _bodies(schemas: JsonObject) -> Iterator[str]:
    for name, schema in schemas.items():
        if "properties" not in schema or name in ("HTTPValidationError", "ValidationError"):
            continue
        required = schema.get("required", ())
        description = " ".join(schema.get("description", "").split())
        yield f"\n### {name}\n\n{description}\n\n| member | | default | limits |\n|---|---|---|---|\n"
        for member, of in schema["properties"].items():
            default = "required" if member in required else f"`{of.get('default')}`"
            yield f"| `{member}` | {_type_of(of)} | {default} | {_limits_of(of)} |\n"


def _type_of(schema: JsonObject | None) -> str:
    """A schema in a few words; other bodies by their names."""
    if schema is None:
        return ""
    if "$ref" in schema:
        return _named(schema["$ref"].rpartition("/")[2])
    several = schema.get("anyOf") or schema.get("oneOf")
    if several:
        return " or ".join(_type_of(one) for one in several)
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{one}`" for one in schema["enum"])
    if schema.get("type") == "array":
        items = schema.get("items") or next(iter(schema.get("prefixItems", ())), None)
        return f"list of {_type_of(items)}"
    return str(schema.get("type", "any value"))


def _named(name: str) -> str:
    """A schema of its own: a link to its table, or what an enumeration may be."""
    if name == Fault.__name__:
        return "[a fault's name](#faults-of-the-controller)"
    schema = _document()["components"]["schemas"][name]
    return _type_of(schema) if "enum" in schema else f"[{name}](#{name.lower()})"


def _limits_of(schema: JsonObject) -> str:
    """Of a number or a text; of one of several, and of a list's items, their own."""
    items = [one for one in (schema.get("items"), *schema.get("prefixItems", ())[:1]) if one]
    inner = [*schema.get("anyOf", ()), *items]
    own = [text.format(schema[name]) for name, text in _BOUNDS if name in schema]
    return ", ".join(own) or next((found for one in inner if (found := _limits_of(one))), "")


def _controller_faults() -> Iterator[str]:
    """From the enumeration's own description; a fault that it does not describe raises."""
    described: dict[str, str] = {}
    for line in (inspect.getdoc(Fault) or "").splitlines():
        if (found := _FAULT_LINE.match(line)) is not None:
            described |= dict.fromkeys(re.findall(r"`([A-Z_]+)`", found[1]), found[2])
    for fault in Fault:
        yield f"| `{fault.value}` | {described[fault.name]} |\n"


def _refusals() -> Iterator[str]:
    source = "\n".join(file.read_text(encoding="utf-8") for file in sorted(_CONTROL.glob("*.py")))
    found = {(int(a or c), b or d) for a, b, c, d in _REFUSAL.findall(source)} | set(_ELSEWHERE)
    return (f"| {status} | `{code}` |\n" for status, code in sorted(found))

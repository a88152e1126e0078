"""`?fields=a,b`: only these members of each item, where bodies are large."""

import json
from typing import Annotated, Final

from fastapi import Depends, Query, Request
from starlette.responses import Response

from services.ui_api.handlers.refusals import RefusalKind, Refused

FIELDS: Final = "fields"
Fields = Annotated[
    str | None,
    Query(
        pattern=r"^[a-z0-9_]{1,64}(,[a-z0-9_]{1,64}){0,31}$",
        description="Only these members of each item, separated by commas.",
    ),
]


async def _fields(fields: Fields = None) -> None:
    """Declares the parameter; `sparse` does what it asks for."""


SPARSE: Final = [Depends(_fields)]


def sparse(request: Request, response: Response) -> Response:
    """The answer with the wanted members alone; raises `Refused` for a name that the items do not have."""
    wanted = request.query_params.get(FIELDS)
    if wanted is None or response.status_code != 200:
        return response
    document = json.loads(bytes(response.body))
    names = wanted.split(",")
    if set(document) == {"items", "next_cursor"}:
        document["items"] = [_only(item, names) for item in document["items"]]
    else:
        document = _only(document, names)
    headers = {name: value for name, value in response.headers.items() if name not in ("content-length", "etag")}
    return Response(json.dumps(document, separators=(",", ":")), 200, headers)


def _only(item: dict[str, object], names: list[str]) -> dict[str, object]:
    for name in names:
        if name not in item:
            raise Refused(
                RefusalKind.MALFORMED, "unknown_field", f"there is no field {name!r}; there are {', '.join(item)}"
            )
    return {name: item[name] for name in names}

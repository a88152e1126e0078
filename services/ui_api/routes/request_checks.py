"""What of a request is checked before its handler runs: the names of its parameters, and what kind of body it brings.

The framework ignores a parameter that is not there, and a client that filters by it would take all for some.
"""

from collections.abc import Collection
from typing import Final

from fastapi import Request
from fastapi._compat import ModelField
from fastapi.dependencies.models import Dependant
from pydantic import BaseModel

from services.ui_api.handlers.refusals import RefusalKind, Refused

_JSON: Final = "application/json"
# Chosen: what a client sent is quoted so far that it can be recognised.
_LONGEST_QUOTED: Final = 60


def query_parameters(dependant: Dependant) -> tuple[str, ...]:
    """Names of the query parameters that a route and what it depends on have."""
    own = [name for field in dependant.query_params for name in _names_of(field)]
    inner = [name for one in dependant.dependencies for name in query_parameters(one)]
    return tuple(dict.fromkeys([*own, *inner]))


def _names_of(field: ModelField) -> list[str]:
    """The parameter's own name, or those of a model of parameters."""
    kind = field.field_info.annotation
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return [one.alias or name for name, one in kind.model_fields.items()]
    return [field.alias]


def require_known_parameters(request: Request, known: Collection[str]) -> None:
    """Refuse a query with a parameter that the operation does not have, or has once only; raises `Refused`."""
    if not request.scope["query_string"]:
        return
    given = [name for name, _ in request.query_params.multi_items()]
    for name in given:
        if name not in known:
            there_are = f"it has {', '.join(known)}" if known else "it has none"
            raise Refused(
                RefusalKind.MALFORMED,
                "unknown_parameter",
                f"{request.method} {request.url.path} has no query parameter {name[:_LONGEST_QUOTED]!r}; {there_are}",
            )
        if given.count(name) > 1:
            raise Refused(
                RefusalKind.MALFORMED,
                "repeated_parameter",
                f"the query parameter {name!r} is there {given.count(name)} times; send it once",
            )


def require_json(request: Request) -> None:
    """Refuse a body that does not say that it is JSON; raises `Refused`."""
    headers = request.headers
    if headers.get("content-length", "0") == "0" and "transfer-encoding" not in headers:
        return
    kind = headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind == _JSON or (kind.startswith("application/") and kind.endswith("+json")):
        return
    found = f"the Content-Type {kind[:_LONGEST_QUOTED]!r}" if kind else "no Content-Type"
    raise Refused(
        RefusalKind.MEDIA_TYPE, "content_type_unsupported", f"the body has {found}; send Content-Type: {_JSON}"
    )

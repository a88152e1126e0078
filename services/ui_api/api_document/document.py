"""The OpenAPI document of an application, whole."""

from collections.abc import Callable, Sequence
from typing import Final

from fastapi.openapi.utils import get_openapi
from starlette.routing import BaseRoute

from services.ui_api.api_document.etags import add_etags
from services.ui_api.api_document.examples import add_examples
from services.ui_api.api_document.links import add_links
from services.ui_api.api_document.operations import JsonObject
from services.ui_api.routes.guards import SECURITY_SCHEMES
from services.ui_api.routes.problems import Problem

_SUMMARY: Final = (
    "Aims a drill guide at the distal holes of an intramedullary nail from one X-ray image. "
    "Research software, not a medical device."
)
_ADDITIONS: Final[Sequence[Callable[[JsonObject], None]]] = (add_etags, add_links, add_examples)


def whole_document(title: str, routes: Sequence[BaseRoute]) -> JsonObject:
    """The document with the problem document among its schemas, headers, links and examples."""
    document: JsonObject = get_openapi(title=title, version="1", summary=_SUMMARY, routes=routes)
    schema = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    definitions = schema.pop("$defs", {})
    components = document["components"]
    assert isinstance(components, dict)
    components["securitySchemes"] = SECURITY_SCHEMES
    components["schemas"] |= {**definitions, "Problem": schema}
    for add in _ADDITIONS:
        add(document)
    return document

"""What the gateway's command does without serving: print the OpenAPI file."""

import json

from services.ui_api.app import openapi_document, routed_app


def print_openapi() -> int:
    """Exit code 0."""
    print(json.dumps(openapi_document(routed_app()), indent=1, ensure_ascii=False))  # noqa: T201 - what was asked for
    return 0

"""`If-None-Match` on everything that is read: 304 without a body when the client has it already."""

from typing import Final

from fastapi import Request
from starlette.responses import Response

from services.ui_api.routes.preconditions import content_hash

_NO_STORE: Final = "no-store"
_KEPT: Final = ("etag", "cache-control", "vary", "content-security-policy", "permissions-policy")


def conditional(request: Request, response: Response) -> Response:
    """The answer with an ETag, or 304; what streams, fails, or says `no-store` stays as it is."""
    body = getattr(response, "body", None)
    if request.method != "GET" or response.status_code != 200 or body is None:
        return response
    if response.headers.get("cache-control") == _NO_STORE:
        return response
    etag = response.headers.setdefault("etag", f'"{content_hash(bytes(body))}"')
    return not_modified(response) if is_known(request, etag) else response


def is_known(request: Request, etag: str) -> bool:
    """Whether the client has this very content, as RFC 9110 13.1.2 compares: weak tags count as well."""
    quoted = request.headers.get("if-none-match", "")
    return quoted.strip() == "*" or etag in {one.strip().removeprefix("W/") for one in quoted.split(",")}


def not_modified(response: Response) -> Response:
    """304 with those headers of an answer that a client needs.

    Browsers put the headers of a 304 in place of those that they kept (RFC 9111 3.2): without the page's own policies a
    page that is loaded again would get those of the interface, under which nothing of it may run.
    """
    kept = {name: response.headers[name] for name in _KEPT if name in response.headers}
    return Response(status_code=304, headers=kept)

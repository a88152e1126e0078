"""`/`: the console, the page for the operating room. Everybody may load it; what it shows needs a login."""

from collections.abc import Mapping
from typing import Final

from fastapi import Request, Response

from services.ui_api.core.roles import Action
from services.ui_api.handlers.refusals import RefusalKind, Refused
from services.ui_api.routes.conditional import is_known, not_modified
from services.ui_api.routes.console_files import ASSETS, INDEX, ConsoleFile
from services.ui_api.routes.guards import needs
from services.ui_api.routes.routers import page_router

router = page_router()
# Code, styles, pictures and requests of this gateway alone, and nothing inline. `blob:`: pictures that the page draws.
_POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' blob:",
        "font-src 'self'",
        "connect-src 'self'",
        "worker-src 'self'",
        "manifest-src 'self'",
        "base-uri 'none'",
        "form-action 'self'",
        "frame-ancestors 'none'",
    )
)
_NEVER_CHANGES: Final = "public, max-age=31536000, immutable"
_ASK_EACH_TIME: Final = "no-cache"


@router.get("/", response_class=Response, openapi_extra=needs(Action.OPEN_CONSOLE))
def read_index(request: Request) -> Response:
    """The page; never taken from a cache without asking, so that a new version is there at the next load."""
    return _sent(request, INDEX, _ASK_EACH_TIME)


@router.get("/assets/{name:path}", response_class=Response, openapi_extra=needs(Action.OPEN_CONSOLE))
def read_asset(request: Request, name: str) -> Response:
    """Code, styles, pictures and languages of the page: each under a name that changes with its content."""
    return _sent(request, ASSETS + name, _NEVER_CHANGES)


def _sent(request: Request, name: str, keeping: str) -> Response:
    files: Mapping[str, ConsoleFile] = request.app.state.console
    file = files.get(name)
    if file is None:
        missing = "it was not built: run `make setup`" if not files else f"it has no file {name[:80]!r}: load it anew"
        raise Refused(RefusalKind.UNKNOWN, "not_found", f"the console: {missing}")
    headers = {
        "etag": file.etag,
        "cache-control": keeping,
        "content-security-policy": _POLICY,
        "permissions-policy": "camera=(), microphone=(), geolocation=(), display-capture=()",
        "vary": "accept-encoding",
    }
    if is_known(request, file.etag):
        return not_modified(Response(headers=headers))
    if file.zipped is not None and "gzip" in request.headers.get("accept-encoding", ""):
        return Response(file.zipped, headers=headers | {"content-encoding": "gzip"}, media_type=file.media_type)
    return Response(file.content, headers=headers, media_type=file.media_type)

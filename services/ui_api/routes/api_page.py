"""`/docs`: the interface's document as a page for people. It loads nothing and runs no script."""

from fastapi import Request, Response

from services.ui_api.core.roles import Action
from services.ui_api.routes.guards import needs
from services.ui_api.routes.routers import page_router

router = page_router()


@router.get("/docs", response_class=Response, openapi_extra=needs(Action.OPEN_CONSOLE))
def read_api_page(request: Request) -> Response:
    """The page, as it was made with the application."""
    content, policy = request.app.state.api_page()
    headers = {"content-security-policy": policy, "cache-control": "no-cache"}
    return Response(content, headers=headers, media_type="text/html; charset=utf-8")

"""Errors of the control API as problem documents (RFC 9457)."""

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from simulation.dicom.sender import ImageNotDelivered
from simulation.room.c_arm import OutOfReach
from simulation.room.drilling import HoleUnknown

_MEDIA_TYPE = "application/problem+json"


class Problem(Exception):
    """A refusal of the control API."""

    def __init__(self, status: int, code: str, detail: str) -> None:
        super().__init__(detail)
        self.status = status
        self.code = code
        self.detail = detail


def problem_response(status: int, code: str, detail: str) -> JSONResponse:
    """Write a problem document."""
    title = code.replace("_", " ").capitalize()
    body = {"type": "about:blank", "title": title, "status": status, "code": code, "detail": detail}
    return JSONResponse(body, status_code=status, media_type=_MEDIA_TYPE)


def add_problem_handlers(app: FastAPI) -> None:
    """Make every refusal and every invalid request a problem document."""

    @app.exception_handler(Problem)
    async def _refused(_: Request, error: Problem) -> JSONResponse:
        return problem_response(error.status, error.code, error.detail)

    @app.exception_handler(HoleUnknown)
    async def _no_hole(_: Request, error: HoleUnknown) -> JSONResponse:
        return problem_response(404, "hole_unknown", str(error))

    @app.exception_handler(OutOfReach)
    async def _too_far(_: Request, error: OutOfReach) -> JSONResponse:
        return problem_response(422, "c_arm_out_of_reach", str(error))

    @app.exception_handler(ImageNotDelivered)
    async def _not_delivered(_: Request, error: ImageNotDelivered) -> JSONResponse:
        return problem_response(502, error.code, str(error))

    @app.exception_handler(RequestValidationError)
    async def _invalid(_: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        place = ".".join(str(p) for p in first["loc"])
        more = f" (and {len(error.errors()) - 1} more)" if len(error.errors()) > 1 else ""
        return problem_response(422, "invalid_request", f"{place}: {first['msg']}{more}")

    @app.exception_handler(HTTPException)
    async def _http(request: Request, error: HTTPException) -> JSONResponse:
        code = {404: "not_found", 405: "method_not_allowed"}.get(error.status_code, "http_error")
        return problem_response(error.status_code, code, f"{request.method} {request.url.path}: {error.detail}")

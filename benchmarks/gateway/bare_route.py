"""A bare FastAPI application with one route for each state, behind a login: what `state_read` compares with.

`python -m benchmarks.gateway.bare_route --port 8001 --robot FILE --case FILE`; the token comes by standard input. The
files have answers of the gateway, so that both write the same bodies.
"""

import argparse
import hashlib
import hmac
import sys
from pathlib import Path
from typing import Annotated, Final

import uvicorn
from fastapi import Depends, FastAPI, HTTPException, Request

from services.ui_api.core.roles import Action, Role, may
from services.ui_api.routes.motion_views import RobotView
from services.ui_api.routes.views import CaseView

_SCHEME: Final = "Bearer "


def bare_app(token: str, robot: RobotView, case: CaseView) -> FastAPI:
    """Both states as FastAPI's own pages would have one write it: a view returned, a dependency for the login."""
    digest = hashlib.sha256(token.encode()).digest()

    async def signed_in(request: Request) -> frozenset[Role]:
        given = request.headers.get("authorization", "").removeprefix(_SCHEME)
        if not hmac.compare_digest(hashlib.sha256(given.encode()).digest(), digest):
            raise HTTPException(401)
        roles = frozenset({Role.SURGEON})
        if not may(roles, Action.READ):
            raise HTTPException(403)
        return roles

    app = FastAPI()

    @app.get("/api/v1/robot")
    async def read_robot(_: Annotated[frozenset[Role], Depends(signed_in)]) -> RobotView:
        return robot

    @app.get("/api/v1/cases/{case_id}")
    async def read_case(case_id: str, _: Annotated[frozenset[Role], Depends(signed_in)]) -> CaseView:  # noqa: ARG001 - as the gateway's route
        return case

    return app


def main() -> int:
    """Serve until ended."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--robot", type=Path, required=True)
    parser.add_argument("--case", type=Path, required=True)
    given = parser.parse_args()
    robot = RobotView.model_validate_json(given.robot.read_bytes())
    case = CaseView.model_validate_json(given.case.read_bytes())
    app = bare_app(sys.stdin.readline().strip(), robot, case)
    uvicorn.run(app, host="127.0.0.1", port=given.port, log_level="warning", access_log=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())

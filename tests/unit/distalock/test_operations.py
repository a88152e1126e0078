"""`distalock operations`: an operation in one line."""

import pytest

from distalock.client.models import OperationView, ProgressView
from distalock.operations import line_of

RUNNING = OperationView(
    id="9d0c",
    verb="move",
    case_id="case-1",
    plan=1,
    hold_to_move=False,
    status="running",
    progress=ProgressView(step=2, steps=3, says="the robot moves", fraction=0.254),
    ended_by="stop",
    began=True,
    code="",
    detail="",
    result=None,
    deviation_mm=None,
    deviation_deg=None,
    requested_at_ns=1,
    ended_at_ns=None,
    approver="Dr A",
    authenticated_by="password",
    permit_sha256=None,
)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({}, "9d0c  move  running  step 2 of 3: the robot moves, 25%"),
        (
            {"status": "failed", "code": "out_of_reach", "detail": "leg 3 is too short; move the mount"},
            "9d0c  move  failed  out_of_reach: leg 3 is too short; move the mount",
        ),
        (
            {"status": "cancelled", "code": "cancelled", "detail": "cancelled by demo: nothing of it is kept"},
            "9d0c  move  cancelled  cancelled by demo: nothing of it is kept",
        ),
        ({"status": "succeeded"}, "9d0c  move  succeeded"),
        (
            {"status": "succeeded", "verb": "plan", "result": "/api/v1/cases/case-1/plans/1"},
            "9d0c  plan  succeeded  /api/v1/cases/case-1/plans/1",
        ),
    ],
)
def test_a_line_says_how_far_it_is_or_what_came_of_it(changes: dict[str, object], line: str) -> None:
    assert line_of(RUNNING.model_copy(update=changes)) == line

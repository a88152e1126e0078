"""A request is a trace: the answer names it, and the robot that is asked to move knows it."""

import pytest
from structlog.contextvars import get_contextvars

from shared.messages.robot import CommandReply, MoveCommand
from shared.tracing import trace_id_of
from tests.unit.services.ui_api.room import Room

TRACE = "0af7651916cd43dd8448eb211c80319c"
ASKED = {"traceparent": f"00-{TRACE}-b7ad6b7169203331-01"}


def test_the_answer_names_the_trace_that_was_asked_for_or_a_new_one(quiet_room: Room) -> None:
    answers = [quiet_room.client.get("/healthz", headers=headers) for headers in (ASKED, {}, {"traceparent": "junk"})]
    traces = [trace_id_of(answer.headers["traceresponse"]) for answer in answers]
    assert traces[0] == TRACE
    assert len({*traces, None}) == 4


def test_a_command_to_the_robot_carries_the_trace_of_its_request(room: Room) -> None:
    seen: list[object] = []
    accept = room.robot.answers_moves

    def note(command: MoveCommand) -> CommandReply:
        seen.append(get_contextvars().get("trace_id"))
        return accept(command)

    room.robot.answers_moves = note
    plan = room.approved_plan(case_id := room.open_case())
    room.client.headers.update(ASKED)
    operation_id = room.post(f"/cases/{case_id}/motions", {"plan": plan}).json()["id"]
    room.wait_for_status(operation_id, "running")
    assert seen == [TRACE]


def test_log_lines_name_the_case_of_the_path(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    bound: list[object] = []
    case_id = room.open_case()
    of_case = room.gateway.record.ledger.cases

    class Noting(dict[str, object]):
        def get(self, key: str, default: object = None) -> object:
            bound.append(get_contextvars().get("case"))
            return super().get(key, default)

        def __getitem__(self, key: str) -> object:
            bound.append(get_contextvars().get("case"))
            return super().__getitem__(key)

    monkeypatch.setattr(room.gateway.record.ledger, "cases", Noting(of_case))
    room.get(f"/cases/{case_id}")
    assert case_id in bound

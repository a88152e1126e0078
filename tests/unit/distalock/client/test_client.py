"""Both clients against a gateway: a case, what is quoted, what is refused, sessions, and the stream of events."""

import asyncio
import contextlib
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from distalock.client import AsyncClient, Client, RequestRefused
from distalock.client.event_models import CaseOpened, StepRecorded
from distalock.client.models import (
    ApprovalBody,
    CaseBody,
    CasePatch,
    MotionBody,
    PlanBody,
    StepBody,
    VerificationBody,
)
from services.ui_api.core.roles import Role
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.people import PASSWORD, add_account
from tests.unit.services.ui_api.room import TOKEN, Room, open_room

SET_UP = CaseBody.model_validate(samples.case_body())
HOLES = ("proximal", "distal")


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Room]:
    with open_room(tmp_path) as room:
        yield room


@pytest.fixture
def client(room: Room) -> Iterator[Client]:
    with Client(str(room.client.base_url), TOKEN) as client:
        yield client


def test_a_case_from_opening_to_its_end(room: Room, client: Client) -> None:
    case = client.open_case(SET_UP)
    image = room.image("first", case.id)
    plan = client.make_plan(case.id, PlanBody(localisation=1, hole_ids=HOLES))
    approval = client.approve_plan(case.id, plan.number)
    assert (approval.plan_sha256, approval.approved_by) == (plan.sha256, "demo")
    operation = client.begin_motion(case.id, MotionBody(plan=plan.number))
    room.wait_for_status(operation.id, "running")
    room.robot.arrive()
    room.wait_for_status(operation.id, "succeeded")
    assert client.read_operation(operation.id).deviation_mm == 0.01
    after = room.image("after", case.id)
    client.read_case(case.id)  # the motion's end was decided by nobody who would have quoted it
    verified = client.make_verification(case.id, VerificationBody(images=(after.sha256,)))
    assert verified.wires[0].exit_offset_mm == 0.3
    closed = client.record_step(case.id, StepBody(step="abandoned", why="the test ends"))
    assert closed.procedure.stage == "abandoned"
    assert [one.id for one in client.iterate_images(case.id, limit=1)] == [image.sha256, after.sha256]
    assert [one.id for one in client.iterate_cases(status="closed")] == [case.id]


def test_a_change_quotes_what_was_read_and_never_what_a_refusal_brought(room: Room, client: Client) -> None:
    case = client.open_case(SET_UP)
    with Client(str(room.client.base_url), TOKEN) as other:
        with pytest.raises(RequestRefused) as unread:
            other.change_case(case.id, CasePatch(side="right"))
        assert (unread.value.status, unread.value.problem_code) == (428, "precondition_required")
        other.read_case(case.id)
        assert other.change_case(case.id, CasePatch(side="right")).revision == 2
    for _ in range(2):
        with pytest.raises(RequestRefused) as late:
            client.change_case(case.id, CasePatch(mount="nail_head"))
        assert late.value.problem_code == "case_changed"
        assert late.value.problem.current is not None
        assert late.value.problem.current["side"] == "right"
    assert client.change_case(case.id, CasePatch(side="left"), if_match=late.value.etag).revision == 3


def test_the_same_key_acts_once(client: Client) -> None:
    case = client.open_case(SET_UP)
    step = StepBody(step="ring_remounted")
    first = client.record_step(case.id, step, idempotency_key="once")
    assert client.record_step(case.id, step, idempotency_key="once").revision == first.revision == 2


def test_what_has_not_changed_is_not_sent_again(room: Room) -> None:
    sent: list[httpx.Response] = []
    with (
        httpx.Client(event_hooks={"response": [sent.append]}) as http,
        Client(str(room.client.base_url), TOKEN, http=http) as client,
    ):
        case = client.open_case(SET_UP)
        room.image("first", case.id)
        first = client.read_case(case.id)
        assert client.read_case(case.id) == first
        assert [answer.status_code for answer in sent] == [201, 200, 304]
        assert client.change_case(case.id, CasePatch(side="right")).revision == 2


def test_a_session_is_renewed_before_it_ends(room: Room) -> None:
    add_account(room, "ada", Role.SURGEON)
    with Client(str(room.client.base_url)) as client:
        with pytest.raises(RequestRefused) as nobody:
            client.list_cases()
        assert nobody.value.problem_code == "token_missing"
        session = client.log_in("ada", PASSWORD)
        client._session = type(client._session)(session.access_token, session.refresh_token, 0.0)
        assert client.read_me().name == "ada"
        assert client._session.access_token != session.access_token
        client.log_out()
        with pytest.raises(RequestRefused):
            client.read_me()


def test_a_surgeon_shows_the_password_again(room: Room) -> None:
    add_account(room, "ada", Role.SURGEON)
    with Client(str(room.client.base_url)) as client:
        client.log_in("ada", PASSWORD)
        case = client.open_case(SET_UP)
        room.image("first", case.id)
        plan = client.make_plan(case.id, PlanBody(localisation=1, hole_ids=HOLES))
        with pytest.raises(RequestRefused) as without:
            client.approve_plan(case.id, plan.number)
        assert without.value.problem_code == "credential_missing"
        approval = client.approve_plan(case.id, plan.number, ApprovalBody(password=PASSWORD))
        assert approval.authenticated_by == "password"


def test_events_are_typed_and_resumable(client: Client) -> None:
    case = client.open_case(SET_UP)
    client.record_step(case.id, StepBody(step="ring_remounted", why="it was loose"))
    events = client.case_events(case.id)
    opened = next(events)
    assert isinstance(opened.data, CaseOpened)
    assert (opened.who, opened.data.setup.side) == ("demo", SET_UP.side)
    later = client.events(after=opened.sequence)
    found = next(one for one in later if one.kind == "step_recorded")
    assert isinstance(found.data, StepRecorded)
    assert (found.data.step, found.case_id) == ("ring_remounted", case.id)
    events.close()
    later.close()


@pytest.mark.parametrize("end", ["\u2028", "\u0085", "\x1c"])
def test_any_end_of_a_line_may_stand_in_a_reason(room: Room, client: Client, end: str) -> None:
    why = f"first{end}second"
    case = client.open_case(SET_UP)
    client.record_step(case.id, StepBody(step="ring_remounted", why=why))
    with contextlib.closing(client.case_events(case.id)) as events:
        assert next(one for one in events if one.kind == "step_recorded").why == why

    async def read() -> str:
        async with AsyncClient(str(room.client.base_url), TOKEN) as awaited:
            return await anext(one.why async for one in awaited.case_events(case.id) if one.kind == "step_recorded")

    assert asyncio.run(read()) == why


def test_a_stream_that_is_refused_raises(room: Room) -> None:
    with Client(str(room.client.base_url), TOKEN) as client, pytest.raises(RequestRefused) as unknown:
        next(client.case_events("nowhere"))
    assert unknown.value.problem_code == "case_not_found"


def test_the_awaited_client_does_the_same(room: Room) -> None:
    add_account(room, "ada", Role.SURGEON)

    async def lead() -> None:
        async with AsyncClient(str(room.client.base_url)) as client:
            await client.log_in("ada", PASSWORD)
            case = await client.open_case(SET_UP)
            room.image("first", case.id)
            plan = await client.make_plan(case.id, PlanBody(localisation=1, hole_ids=HOLES))
            await client.approve_plan(case.id, plan.number, ApprovalBody(password=PASSWORD))
            assert [one.number async for one in client.iterate_plans(case.id)] == [1]
            with pytest.raises(RequestRefused) as unknown:
                await client.read_operation("nowhere")
            assert unknown.value.problem_code == "operation_not_found"
            async for event in client.case_events(case.id):
                assert event.kind == "case_opened"
                break
            await client.log_out()

    asyncio.run(lead())

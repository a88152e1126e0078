"""Stop, loss of the robot service, repeats and approvals, with real processes over REST."""

import os
import signal
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import httpx
import pytest

from benchmarks.common.operating_room import OperatingRoom
from distalock.case_client import CaseClient, is_accepted, summary_of
from distalock.client import RequestRefused
from distalock.client.models import OperationView, PlanView, RobotState
from distalock.rest_client import bearer
from tests.e2e.conftest import shot_at_rest

pytestmark = [pytest.mark.slow, pytest.mark.alone, pytest.mark.timeout(600)]

# The requirement is 0.2 s from the request to locked; both are seen through REST, which the figure includes.
LOCKED_WITHIN_S = 0.2


@dataclass(frozen=True, slots=True)
class Planned:
    """A case with a plan that is ready for approval."""

    site: OperatingRoom
    case: CaseClient
    plan: PlanView

    def robot(self) -> RobotState:
        return robot_of(self.site)

    def start_motion(self) -> OperationView:
        return self.case.begin_motion(self.plan)

    def true_pose(self) -> object:
        return self.site.control.get("/truth")["base_from_top"]


def robot_of(site: OperatingRoom) -> RobotState:
    state = site.gateway.read_robot().state
    assert state is not None
    return state


@pytest.fixture
def planned(site: OperatingRoom) -> Iterator[Planned]:
    """A case of its own in the file's installation, with a plan from where the test before has left the robot.

    Whoever moves the robot all the way stands last: the others need a long way before them.
    """
    case = site.open_case()
    case.make_robot_ready()
    seen = case.localisation_of(shot_at_rest(site))
    assert is_accepted(seen), summary_of(seen)
    yield Planned(site, case, case.plan(seen.number, site.room.scenario().hole_ids))
    case.record_step("abandoned", [], why="the test has ended")


def wait_until(condition: Callable[[], bool], what: str, patience_s: float = 60.0) -> None:
    deadline = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline, f"{what} has not come true within {patience_s} s"
        time.sleep(0.005)


def moving(planned: Planned) -> bool:
    return planned.robot().state == "moving"


@pytest.mark.requirement("ROB-03")
def test_stop_during_motion_locks_at_a_known_position(planned: Planned) -> None:
    planned.case.approve(planned.plan)
    operation = planned.start_motion()
    wait_until(lambda: moving(planned), "moving")
    begun = time.monotonic()
    answer = planned.site.gateway.stop_robot()
    wait_until(lambda: planned.robot().locked is True, "locked")
    took_s = time.monotonic() - begun
    print(f"stop request to locked, seen through REST: {1e3 * took_s:.0f} ms")
    assert answer.confirmed
    assert took_s <= LOCKED_WITHIN_S
    state = planned.robot()
    assert state.state == "stopped"
    assert state.pose is not None
    here = planned.true_pose()
    time.sleep(0.3)  # what is locked must still be there later
    assert planned.true_pose() == here
    ended = planned.case.follow(operation)
    assert ended.status == "stopped"
    with pytest.raises(RequestRefused, match="a motion was made from it"):
        planned.start_motion()
    assert planned.true_pose() == here


@pytest.mark.requirement("GW-01")
def test_without_approval_and_with_a_wire_in_the_bone_nothing_moves(planned: Planned) -> None:
    here = planned.true_pose()
    with pytest.raises(RequestRefused, match=r"(?i)approv") as refusal:
        planned.start_motion()
    print(refusal.value.problem_code, refusal.value)
    assert refusal.value.status in (403, 409)
    planned.case.approve(planned.plan)
    planned.case.record_step("wires_inserted", [planned.site.room.scenario().hole_ids[0]], why="before the move")
    with pytest.raises(RequestRefused) as wired:
        planned.start_motion()
    with pytest.raises(RequestRefused) as reference:
        planned.site.gateway.reference_robot()
    assert (wired.value.problem_code, reference.value.problem_code) == ("wires_in_place", "wires_in_place")
    assert planned.robot().state == "locked"
    assert planned.true_pose() == here


def test_approval_must_quote_the_plan(planned: Planned) -> None:
    path = f"/api/v1/cases/{planned.case.id}/plans/{planned.plan.number}/approval"
    with pytest.raises(RequestRefused) as missing:
        planned.site.rest.post(path)
    assert missing.value.status == 428
    with pytest.raises(RequestRefused) as other:
        planned.site.rest.post(path, if_match=f'"{"0" * 64}"')
    assert other.value.status == 412


@pytest.mark.requirement("REG-08")
def test_a_new_image_makes_an_approved_plan_stale(planned: Planned) -> None:
    planned.case.approve(planned.plan)
    here = planned.true_pose()
    planned.case.localisation_of(planned.site.room.take_shot())
    with pytest.raises(RequestRefused, match=r"(?i)stale|newer|image") as refusal:
        planned.start_motion()
    print(refusal.value.problem_code, refusal.value)
    assert planned.robot().state == "locked"
    assert planned.true_pose() == here


def test_killed_robot_service_is_noticed_and_comes_back_locked(planned: Planned) -> None:
    planned.case.approve(planned.plan)
    operation = planned.start_motion()
    wait_until(lambda: moving(planned), "moving")
    old_epoch = planned.robot().boot_epoch
    fleet = planned.site.fleet
    os.kill(fleet.pids["robot"], signal.SIGKILL)

    def noticed() -> bool:
        view = planned.site.gateway.read_robot()
        return not view.service_alive or view.validity != "current"

    wait_until(noticed, "the gateway notices the loss")
    assert planned.site.gateway.read_operation(operation.id).status != "succeeded"
    with pytest.raises(RequestRefused):
        planned.start_motion()

    fleet.restart("robot")
    wait_until(lambda: planned.robot().boot_epoch != old_epoch, "the robot service is back")
    wait_until(lambda: planned.robot().locked is True, "locked after the restart")
    here = planned.true_pose()
    assert planned.robot().stop == "latched"
    with pytest.raises(RequestRefused) as refusal:
        planned.start_motion()
    print(refusal.value.problem_code, refusal.value)
    assert planned.true_pose() == here
    assert planned.site.gateway.read_operation(operation.id).status in ("failed", "unknown", "stopped")


def test_a_second_identical_motion_request_moves_once(planned: Planned) -> None:
    planned.case.approve(planned.plan)
    url = f"{planned.site.installation.ports.rest_url}/api/v1/cases/{planned.case.id}/motions"
    headers = {"Idempotency-Key": str(uuid.uuid4()), **bearer(planned.site.installation.token)}
    headers["If-Match"] = planned.case.etag()
    body = {"plan": planned.plan.number}
    first, second = (httpx.post(url, json=body, headers=headers) for _ in range(2))
    assert first.status_code == second.status_code == 202
    assert first.json()["id"] == second.json()["id"]
    assert planned.case.follow(OperationView.model_validate(first.json())).status == "succeeded"
    there = planned.true_pose()
    again = httpx.post(url, json=body, headers=headers)
    assert again.json()["id"] == first.json()["id"]
    with pytest.raises(RequestRefused) as refusal:
        planned.start_motion()
    print(refusal.value.problem_code, refusal.value)
    assert planned.true_pose() == there
    assert planned.robot().locked is True

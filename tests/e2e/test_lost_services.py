"""What is lost, frozen or late stops the robot or keeps it where it is: one installation, real processes, REST only."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import httpx
import pytest

from benchmarks.common.operating_room import OperatingRoom
from distalock.case_client import CaseClient, is_accepted, summary_of
from distalock.client.models import OperationView, PlanView, RobotState
from distalock.rest_client import bearer
from tests.e2e.conftest import SEED, operating_room, shot_at_rest

pytestmark = [pytest.mark.slow, pytest.mark.alone, pytest.mark.timeout(600)]

# Longer than any command lives (1 s) and any link's lease (1 s).
FROZEN_S = 2.5


class CaseRoom:
    """A running installation with an open case."""

    def __init__(self, room: OperatingRoom) -> None:
        self.room = room
        self.case: CaseClient = room.open_case()

    def robot(self) -> RobotState:
        state = self.room.gateway.read_robot().state
        assert state is not None
        return state

    def true_pose(self) -> object:
        return self.room.control.get("/truth")["base_from_top"]

    def approved_plan(self) -> PlanView:
        self.case.make_robot_ready()
        seen = self.case.localisation_of(shot_at_rest(self.room))
        assert is_accepted(seen), summary_of(seen)
        plan = self.case.plan(seen.number, self.room.room.scenario().hole_ids)
        self.case.approve(plan)
        return plan

    def begin(self, plan: PlanView) -> OperationView:
        return self.case.begin_motion(plan)

    def begin_to_move(self) -> OperationView:
        begun = self.begin(self.approved_plan())
        wait_until(lambda: self.robot().state == "moving", "moving")
        return begun

    def outcome(self, begun: OperationView) -> OperationView:
        return self.case.follow(begun)

    def application_pid(self) -> int:
        """The gateway's child that is not the encoder of live pictures, which starts with the first viewer."""
        front = self.room.fleet.pids["ui_api"]
        (child,) = Path(f"/proc/{front}/task/{front}/children").read_text().split()
        return int(child)

    def frozen(self, service: str) -> AbstractContextManager[None]:
        """A service that hangs: it keeps its connections and says nothing."""
        return self.frozen_process(self.room.fleet.pids[service])

    @staticmethod
    @contextmanager
    def frozen_process(pid: int) -> Iterator[None]:
        """The same of any process."""
        os.kill(pid, signal.SIGSTOP)
        try:
            yield
        finally:
            os.kill(pid, signal.SIGCONT)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CaseRoom]:
    print(f"scenario seed {SEED}")
    with operating_room(tmp_path_factory.mktemp("room"), SEED) as room:
        yield CaseRoom(room)


def wait_until(condition: Callable[[], bool], what: str, patience_s: float = 60.0) -> None:
    deadline = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline, f"{what} has not come true within {patience_s} s"
        time.sleep(0.01)


def require_standstill(site: CaseRoom) -> None:
    here = site.true_pose()
    time.sleep(0.3)
    assert site.true_pose() == here, "what is stopped must still be there later"


@pytest.mark.requirement("ROB-06")
def test_a_frozen_gateway_stops_the_move(site: CaseRoom) -> None:
    begun = site.begin_to_move()
    with site.frozen("ui_api"):
        time.sleep(0.5)  # the deadline of the heartbeat is 0.2 s; the robot has come to rest soon after
        require_standstill(site)
    ended = site.outcome(begun)
    assert ended.status == "stopped"
    assert "gateway was silent" in ended.detail
    assert site.robot().stop == "latched"


@pytest.mark.long
def test_a_frozen_application_stops_the_move(site: CaseRoom) -> None:
    begun = site.begin_to_move()
    with site.frozen_process(site.application_pid()):
        time.sleep(0.5)  # its beats are missed after 0.25 s, the gateway's heartbeat 0.2 s later
        require_standstill(site)
        assert httpx.post(f"{site.room.installation.ports.rest_url}/api/v1/robot/stop").json()["confirmed"] is True
    ended = site.outcome(begun)
    assert ended.status == "stopped"
    assert site.robot().stop == "latched"


@pytest.mark.long
def test_a_gateway_that_is_told_to_end_lets_the_robot_stop_and_its_streams_come_again(site: CaseRoom) -> None:
    begun = site.begin_to_move()
    installation = site.room.installation
    events = f"{installation.ports.rest_url}/api/v1/events"
    with httpx.stream("GET", events, headers=bearer(installation.token), timeout=60.0) as stream:
        os.kill(site.room.fleet.pids["ui_api"], signal.SIGTERM)
        time.sleep(0.5)  # as when it is silent: see above
        require_standstill(site)
        assert "retry: 3000" in list(stream.iter_lines())[-4:]
    site.room.fleet.restart("ui_api")
    assert site.outcome(begun).status == "stopped"
    assert site.robot().stop == "latched"


@pytest.mark.requirement("ROB-10")
@pytest.mark.long
def test_a_command_that_waited_in_a_frozen_robot_service_moves_nothing(site: CaseRoom) -> None:
    plan = site.approved_plan()
    here = site.true_pose()
    with site.frozen("robot"):
        begun = site.begin(plan)
        time.sleep(FROZEN_S)
    ended = site.outcome(begun)
    assert ended.status == "failed"
    assert "nothing moved" in ended.detail
    assert site.robot().state == "locked"
    assert site.true_pose() == here


def test_nothing_moves_while_registration_cannot_vouch_for_the_plan(site: CaseRoom) -> None:
    plan = site.approved_plan()
    here = site.true_pose()
    with site.frozen("registration"):
        time.sleep(FROZEN_S)
        ended = site.outcome(site.begin(plan))
    assert ended.status == "failed"
    assert "registration has gone" in ended.detail
    assert site.true_pose() == here
    # A motion that never began leaves its plan as it was, and this one is still the newest.
    wait_until(lambda: site.outcome(site.begin(plan)).status == "succeeded", "registration vouches again")


@pytest.mark.requirement("ROB-06")
def test_a_killed_router_stops_the_move_and_everything_comes_back(site: CaseRoom) -> None:
    begun = site.begin_to_move()
    os.kill(site.room.fleet.pids["router"], signal.SIGKILL)
    time.sleep(0.5)
    require_standstill(site)
    site.room.fleet.restart("router")
    ready = f"{site.room.installation.ports.rest_url}/readyz"
    wait_until(lambda: httpx.get(ready).status_code == httpx.codes.OK, "everything is back")
    assert site.outcome(begun).status == "stopped"
    assert site.robot().stop == "latched"


@pytest.mark.requirement("ROB-15")
def test_a_pressed_stop_button_stops_the_move_and_holds(site: CaseRoom) -> None:
    begun = site.begin_to_move()
    site.room.control.post("/faults", {"kind": "controller", "name": "emergency_stop"})
    try:
        ended = site.outcome(begun)
        assert ended.status == "stopped"
        assert "stop button is pressed" in ended.detail
        wait_until(lambda: site.robot().stop_button == "pressed", "the button shows")
        here = site.true_pose()
        acknowledged = site.outcome(site.room.gateway.acknowledge_stop())
        assert acknowledged.status == "failed"
        assert "stop button is pressed" in acknowledged.detail
        assert site.robot().stop == "latched"
        assert site.true_pose() == here, "the button is still pressed: nothing moves"
    finally:
        site.room.control.delete("/faults")
    wait_until(lambda: site.robot().stop_button == "released", "the button is seen to be released")
    assert site.outcome(site.begin(site.approved_plan())).status == "succeeded"
    assert site.robot().stop_button == "clear"

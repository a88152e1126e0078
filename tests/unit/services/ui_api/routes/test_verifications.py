"""A verification speaks of where the guide is now, or does not count."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from services.ui_api.core.events import EventKind
from services.ui_api.routes.idempotency import MOST_ASKING, MOST_REPEATS
from shared.messages.robot import MotionState, StopLatch
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room, wait_until

# Of the application, by default.
THREADS = 40


def _verify(room: Room, case_id: str, name: str) -> tuple[int, str]:
    answer = room.post(f"/cases/{case_id}/verifications", {"images": [samples.sha(name)], "of": "guide"})
    return answer.status_code, answer.json().get("code", answer.json().get("verdict"))


def _plan(room: Room, case_id: str, key: str) -> tuple[int, str]:
    answer = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["distal"]}, key)
    return answer.status_code, answer.text


def _stage(room: Room, case_id: str) -> tuple[str, str]:
    procedure = room.get(f"/cases/{case_id}").json()["procedure"]
    return procedure["stage"], procedure["next"]


@pytest.mark.requirement("GW-04")
def test_after_a_fault_the_guide_is_verified_anew_before_anybody_drills(room: Room) -> None:
    room.image("image", case_id := room.open_case())
    assert _verify(room, case_id, "image") == (201, "accepted")
    room.robot.say(MotionState.FAULT, detail="the guide shifted by 0.2 mm")
    wait_until(lambda: _stage(room, case_id)[0] == "positioning")
    for state, stop in ((MotionState.STOPPED, StopLatch.LATCHED), (MotionState.LOCKED, StopLatch.CLEAR)):
        room.robot.say(state, stop=stop)
    wait_until(lambda: room.get("/robot").json()["state"]["state"] == "locked")
    assert _stage(room, case_id)[1] == "Take one image with ring, guide and both nail holes in view."
    drilled = room.post(f"/cases/{case_id}/steps", {"step": "drilled", "hole_ids": ["distal"]})
    assert (drilled.status_code, drilled.json()["code"]) == (409, "step_out_of_order")
    assert _verify(room, case_id, "image") == (409, "image_stale")
    room.image("after", case_id)
    assert _verify(room, case_id, "after") == (201, "accepted")
    assert _stage(room, case_id) == ("verified", "Drill through the guide: distal.")


@pytest.mark.requirement("GW-04")
def test_an_image_of_before_a_move_verifies_nothing_after_it(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    operation_id = room.post(f"/cases/{case_id}/motions", {"plan": plan}).json()["id"]
    room.wait_for_status(operation_id, "running")
    room.robot.arrive()
    room.wait_for_status(operation_id, "succeeded")
    assert _verify(room, case_id, "image") == (409, "image_stale")
    assert _stage(room, case_id)[0] == "aligned"


@pytest.mark.requirement("GW-04")
@pytest.mark.parametrize("path", ["verifications", "operations"])
def test_a_mount_that_moved_while_registration_compared_leaves_nothing_verified(room: Room, path: str) -> None:
    room.image("image", case_id := room.open_case())
    room.registration.hold.clear()
    wanted = {"images": [samples.sha("image")], "of": "guide"}
    body = wanted if path == "verifications" else {"verification": wanted}
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(room.post, f"/cases/{case_id}/{path}", body)
        assert room.registration.asked.wait(PATIENCE_S)
        assert room.post(f"/cases/{case_id}/steps", {"step": "mount_moved"}).status_code == 201
        room.registration.hold.set()
        if path == "verifications":
            assert (answer.result().status_code, answer.result().json()["code"]) == (409, "image_stale")
    room.log.wait_for_event(lambda e: e.kind is EventKind.VERIFICATION_REFUSED and e.who == "gateway")
    assert _stage(room, case_id)[0] == "positioning"
    assert room.get(f"/cases/{case_id}/verifications").json()["items"] == []


def test_who_waits_for_registration_leaves_threads_to_the_robot(room: Room) -> None:
    """Each verification keeps a thread for as long as registration computes."""
    room.image("image", case_id := room.open_case())
    first = _plan(room, case_id, "answered before")
    room.registration.hold.clear()
    with ThreadPoolExecutor(THREADS) as pool:
        begun = [pool.submit(_verify, room, case_id, "image") for _ in range(THREADS)]
        wait_until(lambda: sum(one.done() for one in begun) == THREADS - MOST_ASKING)
        assert {one.result() for one in begun if one.done()} == {(503, "gateway_busy")}
        assert _plan(room, case_id, "answered before") == first, "who asks again needs no place"
        refused = room.client.put("/api/v1/operations/none/lease", timeout=5.0)
        assert (refused.status_code, refused.json()["code"]) == (404, "operation_not_found")
        assert room.post("/robot/acknowledge-stop").status_code == 202
        room.registration.hold.set()


def test_repeats_of_a_request_that_is_not_answered_are_few(room: Room) -> None:
    """Each waits for the first one's answer, with a thread of its own."""
    room.image("image", case_id := room.open_case())
    room.registration.hold.clear()
    with ThreadPoolExecutor(THREADS) as pool:
        begun = [pool.submit(_plan, room, case_id, "the same") for _ in range(12)]
        wait_until(lambda: sum(one.done() for one in begun) == 12 - 1 - MOST_REPEATS)
        refused = [one.result() for one in begun if one.done()]
        room.registration.hold.set()
    assert {status for status, _ in refused} == {503}
    assert all("send it again when the first is answered" in text for _, text in refused)
    assert {status for status, _ in (one.result() for one in begun)} == {503, 201}
    assert len(room.registration.plan_requests) == 1


def test_a_robot_that_nobody_supervises_is_seen_to_before_anybody_drills(room: Room) -> None:
    room.image("image", case_id := room.open_case())
    assert _verify(room, case_id, "image") == (201, "accepted")
    room.gateway.view.stale_after_s = 0.0
    said = "Nobody supervises the robot: see to its service, the controller's power and cable; do not drill before."
    assert _stage(room, case_id) == ("verified", said)

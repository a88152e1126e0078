"""The control API over HTTP: what a demo or an end-to-end test relies on."""

import asyncio
from dataclasses import dataclass

import httpx
import pytest
from fastapi import FastAPI

from simulation.control.api import control_app
from simulation.controller.virtual_controller import VirtualController
from simulation.room.foot_pedal import FootPedal
from simulation.room.operating_room import OperatingRoom
from tests.unit.simulation import rooms


@dataclass(frozen=True, slots=True)
class Client:
    """Requests to an app in this process."""

    app: FastAPI

    def ask(self, method: str, path: str, body: object = None) -> httpx.Response:
        async def send() -> httpx.Response:
            transport = httpx.ASGITransport(app=self.app)
            async with httpx.AsyncClient(transport=transport, base_url="http://room") as client:
                return await client.request(method, path, json=body)

        return asyncio.run(send())


@pytest.fixture
def client() -> Client:
    scenario = rooms.scenario()
    controller = VirtualController(scenario.parts.hexapod, lambda: 0.0)
    room = OperatingRoom(scenario, lambda: controller.snapshot().base_from_top)
    return Client(control_app(room, FootPedal(room, None), controller))


def test_health(client: Client) -> None:
    assert client.ask("GET", "/healthz").json() == {"status": "ok", "simulated": True}


def test_the_scenario_tells_what_a_case_is_opened_with(client: Client) -> None:
    body = client.ask("GET", "/scenario").json()
    assert body["hole_ids"] == ["distal", "proximal"]
    assert {"side", "bone", "mount", "nail", "guide", "ring", "hexapod", "head_extension_mm"} <= body["case"].keys()
    assert "guide_from_nail" not in body


def test_the_truth_tells_how_far_each_guide_hole_is_off(client: Client) -> None:
    errors = client.ask("GET", "/truth").json()["guide_errors"]
    assert [e["hole_id"] for e in errors] == ["distal", "proximal"]
    assert {"entry_offset_mm", "exit_offset_mm", "angle_deg"} <= errors[0].keys()


def test_a_shot_is_taken_kept_and_becomes_the_truths_last_image(client: Client) -> None:
    assert client.ask("GET", "/truth").json()["last_image"] is None
    assert client.ask("GET", "/shots/last.dcm").json()["code"] == "no_shot_yet"
    shot = client.ask("POST", "/shots")
    assert shot.status_code == 201
    assert shot.json()["delivered_to"] is None
    assert len(shot.json()["sha256"]) == 64
    assert client.ask("GET", "/shots/last.dcm").content[128:132] == b"DICM"
    last = client.ask("GET", "/truth").json()["last_image"]
    assert len(last["balls"]) == 8
    assert len(last["camera_from_nail"]) == 4


def test_the_c_arm_is_turned(client: Client) -> None:
    assert client.ask("PUT", "/c-arm", {"orbital_deg": -80.0, "angular_deg": 2.0}).status_code == 200
    assert client.ask("GET", "/c-arm").json() == {"orbital_deg": -80.0, "angular_deg": 2.0}
    turned = client.ask("POST", "/c-arm/turn", {"about_image_x_deg": 1.0, "about_image_y_deg": 0.0}).json()
    assert turned != {"orbital_deg": -80.0, "angular_deg": 2.0}


def test_wires_and_drills(client: Client) -> None:
    assert len(client.ask("POST", "/wires", {}).json()["items"]) == 2
    assert len(client.ask("GET", "/truth").json()["wires"]) == 2
    assert client.ask("DELETE", "/wires").status_code == 204
    assert client.ask("GET", "/wires").json() == {"items": []}
    drill = client.ask("POST", "/drills", {"hole_id": "distal"}).json()
    assert drill["passed"] is (drill["struck"] is None)
    assert client.ask("GET", "/drills").json()["items"] == [drill]
    assert client.ask("DELETE", "/drills").status_code == 204
    assert client.ask("GET", "/drills").json() == {"items": []}


@pytest.mark.parametrize(
    ("fault", "shown"),
    [
        ({"kind": "low_dose", "dose_factor": 0.1}, {"dose_factor": 0.1}),
        ({"kind": "motion_blur", "length_px": 9.0}, {"motion_blur_px": 9.0}),
        ({"kind": "saturation", "overexposure": 3.0}, {"overexposure": 3.0}),
        ({"kind": "remove_nail"}, {"nail_present": False}),
        ({"kind": "remove_guide"}, {"guide_present": False}),
        ({"kind": "ring_shift", "shift_mm": -2.0}, {"ring_shift_mm": -2.0}),
        ({"kind": "mount_shift", "shift_mm": [1.0, 0.0, 0.0]}, {"mount_shift_mm": [1.0, 0.0, 0.0]}),
        ({"kind": "controller", "name": "emergency_stop"}, {"controller": ["emergency_stop"]}),
    ],
)
def test_faults_are_switched_on_and_off(client: Client, fault: object, shown: dict[str, object]) -> None:
    before = client.ask("GET", "/faults").json()
    after = client.ask("POST", "/faults", fault)
    assert after.status_code == 201
    assert after.json() == {**before, **shown}
    assert client.ask("DELETE", "/faults").status_code == 204
    assert client.ask("GET", "/faults").json() == before


def test_one_fault_of_the_controller_is_mended(client: Client) -> None:
    client.ask("POST", "/faults", {"kind": "controller", "name": "silence"})
    client.ask("POST", "/faults", {"kind": "remove_nail"})
    assert client.ask("DELETE", "/faults/controller/silence").status_code == 204
    left = client.ask("GET", "/faults").json()
    assert left["controller"] == []
    assert left["nail_present"] is False


@pytest.mark.parametrize(
    ("method", "path", "body", "status", "code", "detail"),
    [
        ("POST", "/drills", {"hole_id": "x"}, 404, "hole_unknown", "the guide has no hole 'x'; its holes are"),
        ("POST", "/drills", {}, 422, "invalid_request", "body.hole_id: Field required"),
        ("POST", "/wires", {"hole_ids": ["y"]}, 404, "hole_unknown", "no hole 'y'"),
        ("PUT", "/c-arm", {"orbital_deg": 0.0, "angular_deg": 90.0}, 422, "c_arm_out_of_reach", "it reaches"),
        ("PUT", "/c-arm", {"orbital_deg": "left", "angular_deg": 0.0}, 422, "invalid_request", "body.orbital_deg"),
        ("POST", "/c-arm/turn", {"about_image_x_deg": 1.0}, 422, "invalid_request", "about_image_y_deg"),
        ("POST", "/faults", {"kind": "thunder"}, 422, "invalid_request", "'thunder'"),
        ("POST", "/faults", {"kind": "controller", "name": "rust"}, 422, "invalid_request", "'silence'"),
        ("GET", "/nothing", None, 404, "not_found", "GET /nothing"),
        ("GET", "/drills/1", None, 404, "not_found", "GET /drills/1"),
        ("PATCH", "/c-arm", {}, 405, "method_not_allowed", "PATCH /c-arm"),
    ],
)
def test_what_is_wrong_is_a_problem_document(
    client: Client, method: str, path: str, body: object, status: int, code: str, detail: str
) -> None:
    answer = client.ask(method, path, body)
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.status_code == answer.json()["status"] == status
    assert answer.json()["code"] == code
    assert detail in answer.json()["detail"]


def test_running_fluoroscopy_turns_the_c_arm_on_its_way(client: Client) -> None:
    before = client.ask("GET", "/c-arm").json()
    body = {"images": 4, "images_per_s": 30.0, "places": 2, "about_image_x_deg": 2.0}
    run = client.ask("POST", "/fluoroscopy", body)
    assert run.status_code == 201
    assert (run.json()["images"], run.json()["last"]["number"]) == (4, 4)
    after = client.ask("GET", "/c-arm").json()
    assert run.json()["last"]["c_arm"] == after
    turned = [abs(after[name] - before[name]) for name in ("orbital_deg", "angular_deg")]
    assert 1.5 < sum(turned) < 3.0
    assert client.ask("POST", "/shots").json()["number"] == 5


def test_a_run_beyond_the_c_arms_reach_is_refused_before_it_begins(client: Client) -> None:
    refused = []
    for x, y in ((3.0, 0.0), (-3.0, 0.0), (0.0, 3.0), (0.0, -3.0)):  # one of them leads beyond 80° angular
        client.ask("PUT", "/c-arm", {"orbital_deg": 0.0, "angular_deg": 79.5})
        answer = client.ask("POST", "/fluoroscopy", {"images": 1, "about_image_x_deg": x, "about_image_y_deg": y})
        if answer.status_code == 422:
            refused.append(answer.json()["code"])
            assert client.ask("GET", "/c-arm").json()["angular_deg"] == 79.5
    assert refused
    assert set(refused) == {"c_arm_out_of_reach"}

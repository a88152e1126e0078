"""A head extension entered 10 mm wrong is refused from the first image, over REST, where the mount is known."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from benchmarks.common.operating_room import patient_fleet
from distalock.case_client import CaseClient, is_accepted, summary_of
from distalock.client import Client, RequestRefused
from distalock.installation import Installation, Ports
from distalock.rest_client import JsonObject, RestClient
from distalock.room_client import RoomClient
from shared.parts.hexapod_file import DEFAULT_HEXAPOD
from simulation.scenario.sampling import scenario_of_seed
from tests.e2e.conftest import SEED

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@dataclass(frozen=True, slots=True)
class MountedRoom:
    """A running installation whose hexapod file knows the mount on the nail's head."""

    gateway: Client
    room: RoomClient

    def open_case(self, **changes: object) -> CaseClient:
        set_up: JsonObject = {**self.room.scenario().set_up, **changes}
        return CaseClient.opened(self.gateway, set_up)


def hexapod_with_mount() -> JsonObject:
    """The shipped robot, with the mount that the seed's room has, to 3 mm and 5 degrees."""
    placement = scenario_of_seed(SEED).placement
    base_from_nail = placement.bone_from_base.inverse() @ placement.bone_from_nail
    mount = {
        "base_from_nail_rotation": base_from_nail.rotation.tolist(),
        "base_from_nail_translation_mm": base_from_nail.translation_mm.tolist(),
        "tolerance_mm": [3.0, 3.0, 3.0],
        "tolerance_deg": 5.0,
    }
    content = json.loads(DEFAULT_HEXAPOD.read_bytes())
    assert isinstance(content, dict)
    return {**content, "mounts": {"nail_head": mount}}


@pytest.fixture
def mounted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[MountedRoom]:
    print(f"scenario seed {SEED}")
    hexapod, scenario = tmp_path / "hexapod.json", tmp_path / "scenario.json"
    hexapod.write_text(json.dumps(hexapod_with_mount()))
    scenario.write_text(
        json.dumps(
            {
                "schema": "distalock/scenario/1",
                "units": "mm",
                "seed": SEED,
                "mount": "nail_head",
                "hexapod": "hexapod.json",
            }
        )
    )
    monkeypatch.setenv("DISTALOCK_ROBOT_HEXAPOD_FILE", str(hexapod))
    installation = Installation(Ports.any_free(), tmp_path / "state", scenario_arguments=("--scenario", str(scenario)))
    with (
        patient_fleet(installation),
        Client(installation.ports.rest_url, installation.token) as gateway,
        RestClient(installation.ports.control_url) as control,
    ):
        yield MountedRoom(gateway, RoomClient(control))


@pytest.mark.requirement("REG-11")
def test_a_wrong_extension_is_refused_before_the_first_plan_and_a_right_one_is_not(mounted: MountedRoom) -> None:
    scenario = mounted.room.scenario()
    true_mm = float(str(scenario.set_up["head_extension_mm"]))
    entered_mm = true_mm - 10.0 if true_mm >= 50.0 else true_mm + 10.0
    case = mounted.open_case(head_extension_mm=entered_mm)
    case.make_robot_ready()
    seen = case.localisation_of(mounted.room.take_shot())
    assert is_accepted(seen), summary_of(seen)
    with pytest.raises(RequestRefused) as refused:
        case.plan(seen.number, scenario.hole_ids)
    print(refused.value)
    assert refused.value.problem_code == "head_extension"
    assert f"entered as {entered_mm:g} mm, {true_mm:.0f} mm would fit" in str(refused.value)

    case.change_set_up({"head_extension_mm": true_mm})
    seen = case.localisation_of(mounted.room.take_shot())
    assert is_accepted(seen), summary_of(seen)
    assert case.plan(seen.number, scenario.hole_ids).plan.travel_mm > 0.0

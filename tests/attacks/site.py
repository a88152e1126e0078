"""The system under attack: one installation with certificates, a referenced robot, and an approved plan to move by."""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from distalock.case_client import CaseClient, is_accepted, summary_of
from distalock.client import Client
from distalock.client.models import PlanView
from distalock.installation import Installation, Ports
from distalock.processes import Fleet
from distalock.rest_client import JsonObject, RestClient
from distalock.room_client import RoomClient
from shared.bus.keys import Keys
from shared.bus.settings import BusSettings
from shared.bus.tls import PKI_FOLDER, TlsFiles
from shared.bus.zenoh_bus import ZenohBus, open_bus
from shared.messages.base import decode
from shared.messages.robot import RobotState
from shared.pki.keystore import Keystore

SEED = 2
ROOM = "or1"
START_WITHIN_S = 300.0
PATIENCE_S = 30.0
# What is denied never comes, so it must be waited for; what is allowed came within 20 ms where nothing else ran.
SILENCE_S = 0.7
# A handshake took 5 ms where nothing else ran; a refused one is tried again until this has passed.
REFUSED_WITHIN_S = 0.8


@dataclass(frozen=True, slots=True)
class Site:
    """The running system, and what an attacker can have of it."""

    fleet: Fleet
    installation: Installation
    rest: RestClient
    control: RestClient
    case: CaseClient
    plan: PlanView
    hole_ids: tuple[str, ...]
    scratch: Path

    @property
    def keys(self) -> Keys:
        """Keys of the room's bus."""
        return Keys(ROOM)

    @property
    def keystore(self) -> Keystore:
        """All keys of the installation: each attack says which of them its attacker has."""
        return Keystore(self.installation.state_dir / PKI_FOLDER)

    @property
    def endpoint(self) -> str:
        """Where the router listens."""
        return self.installation.router_endpoint

    @property
    def api(self) -> str:
        """Prefix of the REST interface."""
        return f"{self.installation.ports.rest_url}/api/v1"

    def files_of(self, name: str) -> TlsFiles:
        """Key and certificate of a service."""
        return TlsFiles.in_folder(self.keystore.folder_of(name))

    def open_with(self, files: TlsFiles | None, endpoint: str = "") -> ZenohBus:
        """A session at the router; raises `BusUnavailable` when it gets no link."""
        return open_bus(BusSettings(endpoint or self.endpoint, REFUSED_WITHIN_S, files))

    def open_as(self, name: str) -> ZenohBus:
        """A session with the stolen key of a service; the machine may be busy, so that it has time."""
        return open_bus(BusSettings(self.endpoint, PATIENCE_S, self.files_of(name)))

    def true_pose(self) -> object:
        """Where the hexapod really is: only the virtual room knows."""
        return self.control.get("/truth")["base_from_top"]

    def robot(self) -> JsonObject:
        """The robot's state as REST reports it."""
        state = self.rest.get("/api/v1/robot")["state"]
        assert isinstance(state, dict)
        return state

    def robot_state(self, bus: ZenohBus) -> RobotState:
        """The newest state, as everybody with the gateway's key hears it."""
        heard: list[RobotState] = []
        with closing(
            bus.subscribe_retained(
                self.keys.robot_state, lambda sample: heard.append(decode(RobotState, sample.payload))
            )
        ):
            wait_until(lambda: bool(heard), "a state of the robot")
            return heard[-1]

    def log_files(self) -> tuple[Path, ...]:
        """Logs of all processes."""
        return tuple(sorted((self.installation.state_dir / "logs").glob("*.*")))

    @property
    def case_record(self) -> Path:
        """The gateway's log of events."""
        return self.installation.state_dir / "case-record.sqlite"

    def ready(self) -> bool:
        """Whether the gateway finds everything in order."""
        return bool(self.rest.get("/readyz")["status"] == "ok")


def wait_until(condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
    """Wait for something; raises `TimeoutError`."""
    deadline = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"{what} has not come within {patience_s:g} s")
        time.sleep(0.02)


def silence() -> None:
    """Long enough for what is denied to come, if it came."""
    threading.Event().wait(SILENCE_S)


@contextmanager
def running_site(folder: Path) -> Iterator[Site]:
    """Start everything, and lead a case up to the approved plan; nothing has moved yet."""
    state, scratch = folder / "state", folder / "scratch"
    scratch.mkdir(parents=True)
    os.environ["DISTALOCK_UI_API_UNAPPROVED_PARTS"] = "false"  # as beside a real controller
    installation = Installation(Ports.any_free(), state, scenario_arguments=("--seed", str(SEED)))
    with (
        installation.fleet(threading.Event(), START_WITHIN_S) as fleet,
        Client(installation.ports.rest_url, installation.token) as gateway,
        RestClient(installation.ports.rest_url, installation.token) as rest,
        RestClient(installation.ports.control_url) as control,
    ):
        room = RoomClient(control)
        case = CaseClient.opened(gateway, room.scenario().set_up)
        case.make_robot_ready()
        hole_ids = tuple(room.scenario().hole_ids)
        yield Site(fleet, installation, rest, control, case, approved_plan(case, room), hole_ids, scratch)


def approved_plan(case: CaseClient, room: RoomClient) -> PlanView:
    """Take an image, plan from it and approve the plan."""
    seen = case.localisation_of(room.take_shot())
    assert is_accepted(seen), summary_of(seen)
    plan = case.plan(seen.number, room.scenario().hole_ids)
    case.approve(plan)
    return plan


def approved_move(site: Site) -> str:
    """Ask for the approved move as the gateway's own page would: had it not been for the controls, it was possible.

    Raises
    ------
    AssertionError
        When the robot does not move: then nothing was shown by its standing still.
    """
    before = site.true_pose()
    moved = site.case.move(site.plan)
    assert moved.status == "succeeded", moved.detail
    assert site.true_pose() != before, "the robot stands where it stood"
    return "the approved plan moves the robot when it is asked for as it should be"

"""A gateway with its fakes around it on an in-memory bus, and a client that speaks HTTP to it."""

import re
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import httpx
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from distalock.rest_client import bearer
from services.ui_api.handlers.clock import Clock
from services.ui_api.service import Gateway, open_gateway
from services.ui_api.settings import UiApiSettings
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.tls import PKI_FOLDER
from shared.errors import ReasonCode
from shared.messages.imaging import FrameHeader
from shared.messages.robot import MotionState
from shared.pki.permit_key import PERMIT_KEY_FILE
from shared.runtime.lifecycle import open_service
from tests.new_record import put_new_record
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.fakes import PATIENCE_S, FakeImaging, FakeRegistration, FakeRobot, LogWatch
from tests.unit.services.ui_api.served import served

ROOM = "test"
# Of the user `demo`, who is surgeon and administrator, as in a simulation.
TOKEN = "the token of the user who is signed in"
_keys = count()


def wait_until(condition: Callable[[], bool]) -> None:
    """Wait for what no event announces."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s, "it did not come about"
        time.sleep(0.02)


def new_key() -> str:
    return f"key-{next(_keys)}"


@dataclass(frozen=True, slots=True)
class Room:
    """Everything a test of the gateway touches."""

    router: MemoryRouter
    imaging: FakeImaging
    registration: FakeRegistration
    robot: FakeRobot
    gateway: Gateway
    log: LogWatch
    client: httpx.Client

    def get(self, path: str) -> httpx.Response:
        return self.client.get(f"/api/v1{path}")

    def post(
        self, path: str, body: object | None = None, key: str | None = None, if_match: str | None = None
    ) -> httpx.Response:
        quoted = if_match or self.etag_for(path)
        headers = {"Idempotency-Key": key or new_key(), **({"If-Match": quoted} if quoted else {})}
        return self.client.post(f"/api/v1{path}", json={} if body is None else body, headers=headers)

    def patch(self, path: str, body: object, if_match: str | None = None) -> httpx.Response:
        return self.client.patch(f"/api/v1{path}", json=body, headers={"If-Match": if_match or self.etag_for(path)})

    def etag_for(self, path: str) -> str:
        """The newest ETag of the case that a path is about, as somebody who has just read it; empty without one."""
        within = re.match(r"/cases/[^/]+", path)
        if within is None or path.endswith("/approval"):
            return ""
        return str(self.get(within[0]).headers.get("etag", '"0-none"'))

    def open_case(self) -> str:
        answer = self.post("/cases", samples.case_body())
        assert answer.status_code == 201, answer.text
        return str(answer.json()["id"])

    def image(self, name: str, case_id: str, *reasons: ReasonCode) -> FrameHeader:
        """An image arrives and is localised."""
        header = self.imaging.send(name, case_id)
        ledger = self.gateway.record.ledger
        self.log.wait_for(lambda: ledger.cases[case_id].image(header.sha256) is not None)
        record = self.registration.publish(header, *reasons)
        epoch = record.registration_epoch
        self.log.wait_for(lambda: ledger.cases[case_id].knows_localisation(header.sha256, epoch))
        return header

    def approved_plan(self, case_id: str, name: str = "image") -> int:
        """An image, a plan from it, and a surgeon's approval; the plan's number."""
        self.image(name, case_id)
        newest = len(self.gateway.record.ledger.cases[case_id].localisations)
        answer = self.post(f"/cases/{case_id}/plans", {"localisation": newest, "hole_ids": ["proximal", "distal"]})
        assert answer.status_code == 201, answer.text
        number = int(answer.json()["number"])
        approval = self.post(f"/cases/{case_id}/plans/{number}/approval", if_match=answer.headers["etag"])
        assert approval.status_code == 201, approval.text
        return number

    def unreference(self) -> None:
        """The robot has lost its reference, and the gateway knows it."""
        self.robot.say(MotionState.UNREFERENCED)
        wait_until(lambda: self.get("/robot").json()["state"]["state"] == MotionState.UNREFERENCED)

    def wait_for_status(self, operation_id: str, *statuses: str) -> dict[str, object]:
        """Wait until an operation has one of the statuses; what REST then says of it."""
        operations = self.gateway.record.ledger
        self.log.wait_for(lambda: operations.operations[operation_id].status in statuses)
        answer: dict[str, object] = self.get(f"/operations/{operation_id}").json()
        return answer


def open_room(state_dir: Path, **settings: object) -> AbstractContextManager[Room]:
    """A gateway among its fakes, on a state folder that may have been used before."""
    return open_room_with(FakeRobot, state_dir, **settings)


@contextmanager
def open_room_with(robot_type: type[FakeRobot], state_dir: Path, **settings: object) -> Iterator[Room]:
    """The same with a robot of one's own."""
    router, keys = MemoryRouter(), Keys(ROOM)
    unhurried: dict[str, object] = {
        "robot_state_stale_after_s": 10.0,
        "unapproved_parts": True,
        "demo_token_file": token_file(state_dir),
    }  # the fake robot speaks only when told to
    write_permit_key(state_dir)
    chosen = UiApiSettings(room=ROOM, state_dir=state_dir, **(unhurried | settings))  # type: ignore[arg-type]  # pydantic checks it
    put_new_record(chosen.record_url())
    with ExitStack() as stack:
        imaging = stack.enter_context(FakeImaging(router, keys))
        registration = stack.enter_context(FakeRegistration(router, keys))
        robot = stack.enter_context(robot_type(router, keys))
        bus, runtime = stack.enter_context(open_service("ui_api", chosen, lambda _: router.open()))
        gateway = stack.enter_context(open_gateway(bus, runtime, chosen, Clock()))
        log = LogWatch(gateway.record)
        client = stack.enter_context(
            httpx.Client(
                base_url=stack.enter_context(
                    served(gateway, router, Keys(ROOM), None, chosen.room_networks, chosen.cors_origins)
                ),
                headers=bearer(TOKEN),
                timeout=PATIENCE_S,
            )
        )
        log.wait_for(lambda: gateway.view.newest() is not None)
        yield Room(router, imaging, registration, robot, gateway, log, client)


def token_file(state_dir: Path) -> Path | None:
    """File of the token; None where the folder is one that cannot be made."""
    if not state_dir.parent.is_dir():
        return None
    state_dir.mkdir(exist_ok=True)
    file = state_dir / "demo-token"
    file.write_text(TOKEN, encoding="ascii")
    return file


def write_permit_key(state_dir: Path) -> None:
    """Make the key of permits where the gateway looks for it, unless it is there."""
    file = state_dir / PKI_FOLDER / "ui_api" / PERMIT_KEY_FILE
    if state_dir.parent.is_dir() and not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        pem = Ed25519PrivateKey.generate().private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        file.touch(0o600)
        file.write_bytes(pem)

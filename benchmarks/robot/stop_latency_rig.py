"""Real processes of router, gateway and robot service, and the other ends of their wires, to time a stop."""

import hashlib
import os
import random
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import httpx

from benchmarks.common.operating_room import START_PATIENCE_S, WITHOUT_RATE_LIMITS
from benchmarks.robot.permits import permit_for
from benchmarks.robot.plans import HEXAPOD, plan_between, random_target
from benchmarks.robot.rig import PlainVerb
from distalock.client import RequestRefused
from distalock.demo_user import TOKEN_FILE, demo_token
from distalock.installation import DEMO_TOKEN, Installation, Ports
from distalock.processes import Fleet
from distalock.rest_client import RestClient
from shared.bus.keys import Keys
from shared.bus.port import Bus, Sample
from shared.bus.settings import BusSettings
from shared.bus.tls import PKI_FOLDER, TlsFiles
from shared.bus.zenoh_bus import ZenohBus, open_bus
from shared.errors import NoReply
from shared.messages.base import decode, encode
from shared.messages.cases import CaseContext
from shared.messages.presence import ServiceName
from shared.messages.registration import RegistrationEpoch
from shared.messages.robot import (
    CommandEnvelope,
    CommandReply,
    MotionState,
    MoveCommand,
    PlainCommand,
    RobotState,
)
from shared.pki.permit_key import PERMIT_KEY_FILE, PermitSigner
from shared.scheduling import precedence
from simulation.controller.gcs_protocol import SingleByte
from simulation.controller.servers import tcp_server
from simulation.controller.virtual_controller import VirtualController

KEYS = Keys("or1")
CLIENT = "benchmark"
TARGET_SIZE = 4.0
PATIENCE_S = 20.0
_MOVE = "MOV "
# Longer than the driver's pause between questions (0.02 s), so that one waits for its answer; so short that the stop of
# the driver itself, after 0.25 s of silence, comes more than 0.2 s after the one that is timed.
MUTE_BEFORE_S = 0.04
SET_UP = {
    "side": "right",
    "bone": "femur",
    "mount": "bone",
    "nail": "nail-femur-ti-11",
    "guide": "guide-28",
    "ring": "ring-120",
    "head_extension_mm": 60.0,
}


class ListeningController(VirtualController):
    """Notes when the stop byte and a move arrive; may be mute, but always hears."""

    mute = False
    stopped_s = float("nan")
    stop_heard = threading.Event()
    moved_s = float("nan")
    move_heard = threading.Event()

    def receive(self, command: str | SingleByte) -> bytes:
        """Obey, and answer unless mute."""
        if isinstance(command, str) and command.startswith(_MOVE) and not self.move_heard.is_set():
            self.moved_s = time.monotonic()
            self.move_heard.set()
        if command is SingleByte.STOP_ALL and not self.stop_heard.is_set():
            self.stopped_s = time.monotonic()
            self.stop_heard.set()
        reply = super().receive(command)
        return b"" if self.mute else reply


@dataclass(slots=True)
class StopRig:
    """Everybody around the robot service.

    Attributes
    ----------
    registration, gateway
        Sessions with the certificates of these services.
    signer
        Signs permits with the gateway's key.
    pids
        Of the processes that were started, by name.
    """

    installation: Installation
    pids: Mapping[str, int]
    controller: ListeningController
    registration: Bus
    gateway: Bus
    rest: RestClient
    signer: PermitSigner
    state: RobotState | None = None
    case: tuple[str, int] = ("", -1)
    epoch: str = "registration.1"
    sequence: int = 0
    changed: threading.Condition = field(default_factory=threading.Condition)

    def listen(self) -> None:
        """Follow the robot and the case."""
        self.registration.subscribe_retained(KEYS.robot_state, self._on_state)
        self.registration.subscribe_retained(KEYS.case_context, self._on_case)

    def _on_state(self, sample: Sample) -> None:
        with self.changed:
            self.state = decode(RobotState, sample.payload)
            self.changed.notify_all()

    def _on_case(self, sample: Sample) -> None:
        context = decode(CaseContext, sample.payload)
        with self.changed:
            self.case = (context.case_id or "", context.revision)
            self.changed.notify_all()

    def wait_for_case(self) -> None:
        """Wait until the open case has come over the bus."""
        with self.changed:
            if not self.changed.wait_for(lambda: self.case[0] != "", PATIENCE_S):
                raise TimeoutError(f"no open case was heard of within {PATIENCE_S:g} s")

    def wait(self, condition: Callable[[RobotState], bool]) -> RobotState:
        """Wait for a state."""
        with self.changed:
            there = self.changed.wait_for(lambda: self.state is not None and condition(self.state), PATIENCE_S)
            if not there or self.state is None:
                raise TimeoutError(f"no such state within {PATIENCE_S:g} s; the last is {self.state}")
            return self.state

    def wait_for_newer(self, seen: RobotState) -> None:
        """Wait until the robot has published again."""
        self.wait(lambda s: s.sequence > seen.sequence)

    def envelope(self, state: RobotState) -> CommandEnvelope:
        """For a command that quotes this state."""
        self.sequence += 1
        return CommandEnvelope(
            command_id=f"bench{self.sequence}",
            client=CLIENT,
            client_sequence=self.sequence,
            robot_boot_epoch=state.boot_epoch,
            after_state_sequence=state.sequence,
            issued_at_ns=time.time_ns(),
        )

    def plain(self, verb: PlainVerb) -> CommandReply | None:
        """A command without a plan; None when nobody answered."""
        state = self.wait(lambda _: True)
        envelope = self.envelope(state)
        permit = permit_for(self.signer, envelope, self.case, None) if verb == "reference" else None
        command = encode(PlainCommand(verb=verb, envelope=envelope, permit=permit))
        try:
            return decode(CommandReply, self.gateway.query(KEYS.robot_command(verb), command, 1.0).payload)
        except NoReply:
            return None

    def make_ready(self) -> RobotState:
        """Whatever it takes until the robot is locked and referenced."""
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            state = self.wait(lambda s: s.state not in (MotionState.DISCONNECTED, MotionState.REFERENCING))
            match state.state:
                case MotionState.FAULT:
                    self.plain("reset")
                case MotionState.STOPPED:
                    self.plain("acknowledge_stop")
                case MotionState.UNREFERENCED:
                    self.plain("reference")
                case MotionState.LOCKED if state.locked and state.pose is not None:
                    return state
                case _:
                    pass
            self.wait_for_newer(state)
        raise TimeoutError(f"the robot was not ready within {PATIENCE_S:g} s; it is {self.state}")

    def begin_motion(self, source: random.Random) -> None:
        """Plan somewhere else, as registration, and command it, until the robot moves."""
        plans = self.registration.retained_publisher(KEYS.plan)
        deadline_s = time.monotonic() + PATIENCE_S
        while not self.controller.snapshot().moving:
            state = self.make_ready()
            if state.pose is None or time.monotonic() > deadline_s:
                raise TimeoutError(f"no motion began; the robot is {state}")
            start, target = state.pose.value(), random_target(source, TARGET_SIZE)
            content = encode(plan_between(start, target, self.epoch, state.boot_epoch, self.case))
            plans.put(content)
            time.sleep(0.02)  # plan and command come on different keys
            self._command(state, content)
        plans.close()

    def _command(self, state: RobotState, plan: bytes) -> None:
        sha256, envelope = hashlib.sha256(plan).hexdigest(), self.envelope(state)
        permit = permit_for(self.signer, envelope, self.case, sha256)
        command = MoveCommand(envelope=envelope, plan_sha256=sha256, permit=permit)
        try:
            self.gateway.query(KEYS.robot_command("move"), encode(command), 1.0)
        except NoReply:
            return
        asked_s = time.monotonic()
        while not self.controller.snapshot().moving and time.monotonic() < asked_s + 0.5:
            time.sleep(0.002)

    def stop_latency_s(self, source: random.Random, *, mute: bool) -> float:
        """One trial: begin a motion, ask for a stop somewhere in it, and time the byte."""
        self.begin_motion(source)
        return self.stopped_within_s(source, mute=mute)

    def stopped_within_s(self, source: random.Random, *, mute: bool = False) -> float:
        """Ask for a stop somewhere in the motion that is under way, and time the byte."""
        time.sleep(source.uniform(0.02, 0.15))
        if mute:
            self.controller.mute = True
            time.sleep(MUTE_BEFORE_S)
        self.controller.stop_heard.clear()
        asked_s = time.monotonic()
        try:
            self._ask_for_stop()
            if not self.controller.stop_heard.wait(PATIENCE_S):
                raise TimeoutError(f"no stop byte within {PATIENCE_S:g} s")
        finally:
            self.controller.mute = False
        return self.controller.stopped_s - asked_s

    def _ask_for_stop(self) -> None:
        """Over REST. A mute controller does not show that it stands still, so that the stop is not confirmed."""
        try:
            self.rest.post("/api/v1/robot/stop")
        except RequestRefused as refusal:
            if refusal.problem_code != "stop_not_confirmed":
                raise


@contextmanager
def stop_rig(controller: ListeningController | None = None) -> Iterator[StopRig]:
    """An installation of its own, for as long as the context lasts; with this controller, or a new one."""
    ports = Ports.any_free()
    controller = controller or ListeningController(HEXAPOD, time.monotonic)
    ended = threading.Event()
    os.environ |= WITHOUT_RATE_LIMITS  # a thousand consoles have one token and one address here
    # Controller and console, for which this process stands, have processors of their own.
    with tempfile.TemporaryDirectory() as folder, precedence(), tcp_server(controller) as gcs_port:
        installation = Installation(ports, Path(folder), f"socket://127.0.0.1:{gcs_port}")
        with (
            _robot_and_gateway(installation) as fleet,
            _session(installation, "registration") as registration,
            _session(installation, "ui_api") as gateway,
            RestClient(ports.rest_url, installation.token) as rest,
        ):
            signer = PermitSigner.from_file(installation.state_dir / PKI_FOLDER / "ui_api" / PERMIT_KEY_FILE)
            rig = StopRig(installation, fleet.pids, controller, registration, gateway, rest, signer)
            rig.listen()
            rest.post("/api/v1/cases", SET_UP)
            rig.wait_for_case()
            confirming = threading.Thread(target=_confirm_epoch, args=(registration, rig.epoch, ended), daemon=True)
            confirming.start()
            try:
                yield rig
            finally:
                ended.set()
                confirming.join()


def _robot_and_gateway(installation: Installation) -> Fleet:
    """The installation without the services that the rig stands for."""
    demo_token(installation.state_dir)  # the controller is none of a virtual room, so that nobody else makes it
    wanted = [spec for spec in installation.specs() if spec.name in ("router", "robot")]
    wanted += [
        replace(
            spec,
            is_ready=lambda: _is_well(installation.ports.rest),
            environment={**spec.environment, DEMO_TOKEN: str(installation.state_dir / TOKEN_FILE)},
        )
        for spec in installation.specs()
        if spec.name == "ui_api"
    ]
    return Fleet(wanted, installation.state_dir / "logs", START_PATIENCE_S, prepare=installation.make_keys)


def _session(installation: Installation, service: ServiceName) -> ZenohBus:
    files = TlsFiles.in_state(installation.state_dir, service)
    return open_bus(BusSettings(installation.router_endpoint, tls=files))


def _is_well(rest_port: int) -> bool:
    try:
        return httpx.get(f"http://127.0.0.1:{rest_port}/healthz", timeout=1.0).status_code == httpx.codes.OK
    except httpx.HTTPError:
        return False


def _confirm_epoch(bus: Bus, epoch: str, ended: threading.Event) -> None:
    """Say, as registration does, that nothing newer has come."""
    words = bus.publisher(KEYS.registration_epoch)
    number = 0
    while not ended.wait(0.1):
        number += 1
        words.put(encode(RegistrationEpoch(boot_epoch="registration", sequence=number, registration_epoch=epoch)))

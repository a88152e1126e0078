"""The robot service from the bus down to the bytes of the virtual controller, in time that passes only when told to.

Service, guard, drive and driver are the product's. No thread ticks but the driver's reader: a rig with the same seed
does the same again, as long as the machine answers within the driver's (short) time-out.
"""

import hashlib
import random
from dataclasses import dataclass
from typing import Literal, TypeAlias

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from benchmarks.robot.memory_port import MemoryPort
from benchmarks.robot.permits import permit_for
from benchmarks.robot.plans import HEXAPOD, plan_between
from benchmarks.robot.still_bus import StillBus
from services.robot.core.deviation import Deviation
from services.robot.core.guard_context import GuardLimits
from services.robot.core.status import DriveStatus
from services.robot.core.tuning import SUPERVISION
from services.robot.devices.gcs.controller import GcsController
from services.robot.drive.drive import Drive
from services.robot.service import RobotParts, RobotService
from shared.bus.keys import Keys
from shared.bus.port import Sample
from shared.geometry.hexapod import PlatformPose
from shared.messages.base import decode, encode
from shared.messages.cases import CaseContext
from shared.messages.presence import Heartbeat
from shared.messages.registration import Plan, RegistrationEpoch
from shared.messages.robot import (
    CommandEnvelope,
    CommandReply,
    MoveCommand,
    PlainCommand,
    RobotState,
    StopCommand,
    Verb,
)
from shared.pki.permit_key import PermitSigner, PermitVerifier
from simulation.controller.accuracy import PlatformError
from simulation.controller.virtual_controller import VirtualController

KEYS = Keys("or1")
_GATEWAY_KEY = Ed25519PrivateKey.generate()
SIGNER = PermitSigner(_GATEWAY_KEY)
FOREIGN_SIGNER = PermitSigner(Ed25519PrivateKey.generate())
REPLY_TIMEOUT_S = 0.015
TICK_S = 0.1
LIMITS = GuardLimits(Deviation(20.0, 12.0), 600.0, 0.2, 1.0)
QUERY_TIMEOUT_S = 1.0
CASE_ID = "case1"
PlainVerb: TypeAlias = Literal["reference", "acknowledge_stop", "reset"]


@dataclass(frozen=True, slots=True)
class SentCommand:
    """A command as it went over the bus: to be sent again, late, or in another order."""

    verb: Verb
    payload: bytes


class Rig:
    """The robot service with everything around it.

    Parameters
    ----------
    reply_timeout_s
        Real time for which the driver waits for an answer: short where a sequence has many silences.
    error
        How the platform differs from its encoders; not at all unless given.

    Attributes
    ----------
    gateway_alive, registration_alive
        Whether they give signs of life as time passes.
    sent_moves
        Every `MOV` line that the driver wrote, before the line could spoil it.
    state
        The newest published state.
    """

    def __init__(self, seed: int, reply_timeout_s: float = REPLY_TIMEOUT_S, error: PlatformError | None = None) -> None:
        self.now_s = 1000.0
        self._reply_timeout_s = reply_timeout_s
        self.random = random.Random(seed)
        self.bus = StillBus()
        self.virtual = VirtualController(HEXAPOD, self.clock, error, noise=random.Random(seed + 1))
        self.sent_moves: list[str] = []
        self.crashes: list[str] = []
        self.gateway_alive = self.registration_alive = True
        self.gateway_boot, self.registration_boot = "gateway1", "reg1"
        self.epoch = "reg1.1"
        self.case_revision = 1
        self._sequences = dict.fromkeys(("command", "heartbeat", "word"), 0)
        self.state: RobotState
        self.bus.subscribe(KEYS.robot_state, self._on_state)
        self.drive = Drive(self._connect, SUPERVISION.read_back, self.clock, 1.0, self.crashes.append)
        parts = RobotParts(
            hexapod=HEXAPOD,
            limits=LIMITS,
            drive=self.drive,
            boot_epoch="boot",
            clock_s=self.clock,
            note_change=lambda _: None,
            permit_verifier=PermitVerifier(_GATEWAY_KEY.public_key()),
            note_permit=lambda _outcome, _sha256: None,
        )
        self.service = RobotService(self.bus, KEYS, parts)
        self.service.listen()
        self.service.answer()
        self.open_case()
        self.tick()

    @property
    def case(self) -> tuple[str, int]:
        """Id and revision of the open case."""
        return (CASE_ID, self.case_revision)

    def clock(self) -> float:
        """The only clock there is."""
        return self.now_s

    def _connect(self) -> GcsController:
        return GcsController(MemoryPort(self.virtual, self.sent_moves), HEXAPOD, reply_timeout_s=self._reply_timeout_s)

    def _on_state(self, sample: Sample) -> None:
        self.state = decode(RobotState, sample.payload)

    def _next(self, what: str) -> int:
        self._sequences[what] += 1
        return self._sequences[what]

    # Time and the others

    def tick(self, seconds: float = TICK_S) -> None:
        """Let time pass, let the others give signs of life, let the service do one round of its work."""
        self.now_s += seconds
        self.give_signs_of_life()
        self.service.watch.check()
        self.drive.step()
        self.service.publish(self.drive.status)

    def give_signs_of_life(self) -> None:
        """Heartbeat of the gateway and word of registration, of those that are alive."""
        if self.gateway_alive:
            beat = Heartbeat(service="ui_api", boot_epoch=self.gateway_boot, sequence=self._next("heartbeat"))
            self.bus.deliver(Sample(KEYS.heartbeat("ui_api"), encode(beat), b""))
        if self.registration_alive:
            word = RegistrationEpoch(
                boot_epoch=self.registration_boot, sequence=self._next("word"), registration_epoch=self.epoch
            )
            self.bus.deliver(Sample(KEYS.registration_epoch, encode(word), b""))

    def open_case(self) -> None:
        """The gateway says which case is open, in which revision."""
        context = CaseContext(case_id=CASE_ID, revision=self.case_revision)
        self.bus.deliver(Sample(KEYS.case_context, encode(context), b""))

    def begin_epoch(self) -> None:
        """A new image has arrived."""
        self.epoch = f"{self.registration_boot}.{self._next('word')}"
        self.give_signs_of_life()

    def publish_plan(self, target: PlatformPose) -> bytes:
        """Registration publishes a plan from where the robot says it stands; its bytes."""
        content = encode(self.plan_to(target))
        self.bus.deliver(Sample(KEYS.plan, content, b""))
        return content

    def plan_to(self, target: PlatformPose) -> Plan:
        """A plan from where the robot says it stands."""
        start = HEXAPOD.home_pose if self.state.pose is None else self.state.pose.value()
        return plan_between(start, target, self.epoch, "boot", self.case)

    # Commands

    def envelope(self, command_id: str | None = None) -> CommandEnvelope:
        """For a command that quotes the newest state."""
        number = self._next("command")
        return CommandEnvelope(
            command_id=command_id or f"c{number}",
            client="gateway",
            client_sequence=number,
            robot_boot_epoch="boot",
            after_state_sequence=self.state.sequence,
            issued_at_ns=0,
        )

    def plain(self, verb: PlainVerb) -> SentCommand:
        """A command without a plan."""
        envelope = self.envelope()
        permit = permit_for(SIGNER, envelope, self.case, None) if verb == "reference" else None
        return SentCommand(verb, encode(PlainCommand(verb=verb, envelope=envelope, permit=permit)))

    def move(
        self, plan_json: bytes, envelope: CommandEnvelope | None = None, signer: PermitSigner = SIGNER
    ) -> SentCommand:
        """A command to carry a plan out, with its permit."""
        sha256 = hashlib.sha256(plan_json).hexdigest()
        envelope = envelope or self.envelope()
        permit = permit_for(signer, envelope, self.case, sha256)
        return SentCommand("move", encode(MoveCommand(envelope=envelope, plan_sha256=sha256, permit=permit)))

    def ask(self, command: SentCommand) -> CommandReply:
        """Send a command and read the answer; raises `NoReply` while the link is down."""
        key = KEYS.robot_command(command.verb)
        return decode(CommandReply, self.bus.query(key, command.payload, QUERY_TIMEOUT_S).payload)

    def stop(self) -> None:
        """Ask for a stop; raises `NoReply` while the link is down."""
        self.bus.query(KEYS.robot_command("stop"), encode(StopCommand(client="gateway")), QUERY_TIMEOUT_S)

    def make_ready(self) -> None:
        """Acknowledge and reference until the robot is locked, as a person would from a console."""
        steps: tuple[tuple[PlainVerb, str], ...] = (("acknowledge_stop", "stopped"), ("reference", "unreferenced"))
        for verb, state in steps:
            self.tick()
            self.tick()
            if self.state.state == state:
                self.ask(self.plain(verb))
            self.tick()
        self.tick()

    def leave(self) -> None:
        """The service ends."""
        self.drive.leave()
        while self.drive.step():
            pass

    @property
    def status(self) -> DriveStatus:
        """What the drive knows."""
        return self.drive.status

"""The robot service from the bus down to the bytes of the virtual controller, in time that passes only when told to.

Service, guard, drive and driver are the product's. No thread ticks but the driver's reader: a rig with the same seed
does the same again, as long as the machine answers within the driver's (short) time-out.
"""

import hashlib
import random
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from benchmarks.robot_still_bus import StillBus
from services.robot.core.readings import READ_BACK_TOLERANCE, Deviation
from services.robot.core.situation import GuardLimits
from services.robot.core.status import DriveStatus
from services.robot.devices.gcs_controller import GcsController
from services.robot.drive import Drive
from services.robot.service import RobotParts, RobotService
from shared.bus.keys import Keys
from shared.bus.port import Sample
from shared.geometry.frames import Guide
from shared.geometry.hexapod import PlatformPose, base_from_top, leg_lengths_mm
from shared.geometry.transform import Transform
from shared.messages.base import decode, encode, matrix4, vector3
from shared.messages.cases import CaseContext
from shared.messages.presence import Heartbeat
from shared.messages.registration import Plan, RegistrationEpoch
from shared.messages.robot import (
    Approval,
    CommandEnvelope,
    CommandReply,
    MoveCommand,
    PlainCommand,
    PlatformPoseMessage,
    RobotState,
    StopCommand,
    Verb,
)
from shared.parts.hexapod_file import default_hexapod
from simulation.controller.gcs_protocol import Assembler
from simulation.controller.virtual_controller import VirtualController

HEXAPOD = default_hexapod()
KEYS = Keys("or1")
EXTENSION_MM = 60.0
REPLY_TIMEOUT_S = 0.015
READ_WAIT_S = 0.005
TICK_S = 0.1
LIMITS = GuardLimits(Deviation(20.0, 12.0), 600.0, 0.2, 1.0)
QUERY_TIMEOUT_S = 1.0
NO_SHA = "d" * 64
PlainVerb: TypeAlias = Literal["reference", "acknowledge_stop", "reset"]


class MemoryPort:
    """A line to the virtual controller within the process; the controller acts at once.

    Parameters
    ----------
    sent
        Where every `MOV` line is noted, before the line can spoil it.
    carry
        What the line does to bytes, going either way; what the virtual controller's faults do when not given.
    """

    def __init__(
        self, virtual: VirtualController, sent: list[str], carry: Callable[[bytes], bytes] | None = None
    ) -> None:
        self._carry = carry or virtual.carried
        self._virtual = virtual
        self._sent = sent
        self._assembler = Assembler()
        self._ready = threading.Condition()
        self._output = bytearray()
        self._late = bytearray()

    def read(self, size: int = 1, /) -> bytes:
        """As pyserial reads."""
        with self._ready:
            if not self._output:
                self._ready.wait(READ_WAIT_S)
            received = bytes(self._output[:size])
            del self._output[:size]
            return received

    def write(self, data: bytes, /) -> int:
        """As pyserial writes. Answers that are late come with the next thing that is written."""
        self._sent += [line for line in data.decode("ascii").splitlines() if line.startswith("MOV ")]
        with self._ready:
            self._output += self._late
            self._late.clear()
            for command in self._assembler.feed(self._carry(data)):
                reply = self._carry(self._virtual.receive(command))
                if self._virtual.reply_delay_s() > 0.0:
                    self._late += reply
                else:
                    self._output += reply
            self._ready.notify_all()
        return len(data)

    def close(self) -> None:
        """Nothing to do."""


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

    Attributes
    ----------
    gateway_alive, registration_alive
        Whether they give signs of life as time passes.
    sent_moves
        Every `MOV` line that the driver wrote, before the line could spoil it.
    state
        The newest published state.
    """

    def __init__(self, seed: int, reply_timeout_s: float = REPLY_TIMEOUT_S) -> None:
        self.now_s = 1000.0
        self._reply_timeout_s = reply_timeout_s
        self.random = random.Random(seed)
        self.bus = StillBus()
        self.virtual = VirtualController(HEXAPOD, self.clock, noise=random.Random(seed + 1))
        self.sent_moves: list[str] = []
        self.crashes: list[str] = []
        self.gateway_alive = self.registration_alive = True
        self.gateway_boot, self.registration_boot = "gateway1", "reg1"
        self.epoch = "reg1.1"
        self.case_revision = 1
        self._sequences = dict.fromkeys(("command", "heartbeat", "word"), 0)
        self.state: RobotState
        self.bus.subscribe(KEYS.robot_state, self._on_state)
        self.drive = Drive(self._connect, READ_BACK_TOLERANCE, self.clock, 1.0, self.crashes.append)
        parts = RobotParts(HEXAPOD, LIMITS, self.drive, "boot", self.clock, lambda _: None)
        self.service = RobotService(self.bus, KEYS, parts)
        self.service.listen()
        self.service.answer()
        self.open_case()
        self.tick()

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
        self.service.watch.look()
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
        context = CaseContext(case_id="case1", revision=self.case_revision)
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
        start = HEXAPOD.home_pose if self.state.pose is None else pose_value(self.state.pose)
        return plan_between(start, target, self.epoch, "boot", ("case1", self.case_revision))

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
        return SentCommand(verb, encode(PlainCommand(verb=verb, envelope=self.envelope())))

    def move(
        self, plan_json: bytes, approved_sha256: str | None = None, envelope: CommandEnvelope | None = None
    ) -> SentCommand:
        """A command to carry a plan out, with its approval."""
        sha256 = approved_sha256 or hashlib.sha256(plan_json).hexdigest()
        approval = Approval(plan_sha256=sha256, approved_by="surgeon", approved_at_ns=0)
        envelope = envelope or self.envelope()
        return SentCommand(
            "move", encode(MoveCommand(envelope=envelope, plan_json=plan_json.decode(), approval=approval))
        )

    def ask(self, command: SentCommand) -> CommandReply:
        """Send a command and read the answer; raises `NoReply` while the link is down."""
        key = KEYS.robot_command(command.verb)
        return decode(CommandReply, self.bus.query(key, command.payload, QUERY_TIMEOUT_S).payload)

    def stop(self) -> None:
        """Ask for a stop; raises `NoReply` while the link is down."""
        self.ask(SentCommand("stop", encode(StopCommand(client="gateway"))))

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


def plan_between(
    start: PlatformPose, target: PlatformPose, epoch: str, robot_boot_epoch: str, case: tuple[str, int]
) -> Plan:
    """A plan as registration would make it, for a case of this id and revision."""
    top_from_guide = HEXAPOD.top_from_guide(EXTENSION_MM)
    here = base_from_top(HEXAPOD, start, HEXAPOD.pivot_mm) @ top_from_guide
    there = base_from_top(HEXAPOD, target, HEXAPOD.pivot_mm) @ top_from_guide
    correction: Transform[Guide, Guide] = here.inverse() @ there
    a, b, c, d, e, f = (float(v) for v in leg_lengths_mm(HEXAPOD, target.as_array(), HEXAPOD.pivot_mm))
    return Plan(
        case_id=case[0],
        case_revision=case[1],
        image_sha256=NO_SHA,
        registration_epoch=epoch,
        robot_boot_epoch=robot_boot_epoch,
        hexapod_sha256=HEXAPOD.sha256,
        hole_ids=("distal",),
        head_extension_mm=EXTENSION_MM,
        guide_from_target_guide=matrix4(correction),
        start_pose=_message(start),
        target_pose=_message(target),
        pivot_mm=vector3(HEXAPOD.pivot_mm),
        target_leg_lengths_mm=(a, b, c, d, e, f),
        travel_mm=float(np.linalg.norm(target.as_array()[:3] - start.as_array()[:3])),
        travel_deg=0.0,
        axial_shift_mm=0.0,
        predicted=(),
    )


def pose_value(message: PlatformPoseMessage) -> PlatformPose:
    """A pose from the wire."""
    return PlatformPose(message.x_mm, message.y_mm, message.z_mm, message.u_deg, message.v_deg, message.w_deg)


def _message(pose: PlatformPose) -> PlatformPoseMessage:
    x, y, z, u, v, w = (float(value) for value in pose.as_array())
    return PlatformPoseMessage(x_mm=x, y_mm=y, z_mm=z, u_deg=u, v_deg=v, w_deg=w)


def random_target(source: random.Random, size: float) -> PlatformPose:
    """A pose within `size` (mm and degrees) of the middle on every axis, to a micrometre as people would give it."""
    return PlatformPose(*(round(source.uniform(-size, size), 3) for _ in range(6)))

"""The robot service on an in-memory bus, with a controller that has no line, and everybody around it."""

import hashlib
import itertools
import time
from collections.abc import Callable

import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from services.robot.core.deviation import Deviation
from services.robot.core.guard_context import GuardLimits
from services.robot.core.permits import Permit as CorePermit
from services.robot.core.refusals import Refusal
from services.robot.core.tuning import SUPERVISION
from services.robot.drive.drive import Drive
from services.robot.service import RobotParts, RobotService
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Sample
from shared.geometry.frames import Guide
from shared.geometry.hexapod import ZERO_POSE, PlatformPose, base_from_top, leg_lengths_mm, platform_pose
from shared.geometry.transform import Transform
from shared.messages.base import decode, encode
from shared.messages.cases import CaseContext, ObjectInside
from shared.messages.geometry import matrix4, vector3
from shared.messages.permits import Permit, SignedPermit
from shared.messages.presence import Heartbeat
from shared.messages.registration import Plan, RegistrationEpoch
from shared.messages.robot import (
    CommandEnvelope,
    CommandReply,
    MotionState,
    MoveCommand,
    PlainCommand,
    PlatformPoseMessage,
    RobotState,
    Verb,
)
from shared.parts.hexapod_file import default_hexapod
from shared.pki.permit_key import PermitSigner, PermitVerifier
from tests.unit.services.robot.fake_controller import FakeController

HEXAPOD = default_hexapod()
KEYS = Keys("or1")
SHA = "d" * 64
GATEWAY_KEY = Ed25519PrivateKey.generate()
SIGNER = PermitSigner(GATEWAY_KEY)
WAIT_S = 60.0


class Room:
    """A room's bus with the robot service on it, and the others' side of every conversation."""

    def __init__(self) -> None:
        self.router = MemoryRouter()
        self.controller = FakeController()
        self.clock_offset_s = 0.0
        self.bus = self.router.open()
        self.states: list[RobotState] = []
        self.sequence = 0
        self.heartbeats = 0
        self.bus.subscribe_retained(KEYS.robot_state, self._on_state)
        self.beat = self.bus.publisher(KEYS.heartbeat("ui_api"))
        self.words = 0
        self.epochs = self.bus.publisher(KEYS.registration_epoch)
        self.plans = self.bus.retained_publisher(KEYS.plan)
        self.cases = self.bus.retained_publisher(KEYS.case_context)
        self.case_revision = 1
        self.say_case()
        drive = Drive(lambda: self.controller, SUPERVISION.read_back, self.clock, 0.05, lambda _: None)
        # The heartbeat's deadline is a second here: what is tested is what follows, and the machine may be busy.
        limits = GuardLimits(Deviation(20.0, 12.0), 600.0, 1.0, 5.0)
        self.noted: list[tuple[CorePermit | Refusal, str]] = []
        self._nonces = itertools.count()
        parts = RobotParts(
            hexapod=HEXAPOD,
            limits=limits,
            drive=drive,
            boot_epoch="boot",
            clock_s=self.clock,
            note_change=lambda _: None,
            permit_verifier=PermitVerifier(GATEWAY_KEY.public_key()),
            note_permit=lambda outcome, sha256: self.noted.append((outcome, sha256)),
        )
        self.service = RobotService(self.router.open(), KEYS, parts)

    def clock(self) -> float:
        return time.monotonic() + self.clock_offset_s

    def _on_state(self, sample: Sample) -> None:
        self.states.append(decode(RobotState, sample.payload))

    @property
    def state(self) -> RobotState:
        return self.states[-1]

    def wait(self, condition: Callable[[RobotState], bool]) -> RobotState:
        """Wait until a state that fulfils the condition is published, from now on or last."""
        deadline = time.monotonic() + WAIT_S
        looked_at = max(len(self.states) - 1, 0)
        while time.monotonic() < deadline:
            for state in self.states[looked_at:]:
                if condition(state):
                    return state
            looked_at = len(self.states)
            time.sleep(0.002)
        pytest.fail(f"no such state within {WAIT_S} s; the last is {self.states[-1:]}")

    def let_states_pass(self) -> None:
        """Wait until the robot has published again: whatever was on its way has arrived, and time has passed for it."""
        before = self.state.sequence
        self.wait(lambda s: s.sequence > before + 2)

    def heartbeat(self, boot_epoch: str = "gateway1") -> None:
        self.heartbeats += 1
        self.beat.put(encode(Heartbeat(service="ui_api", boot_epoch=boot_epoch, sequence=self.heartbeats)))

    def envelope(self, command_id: str | None = None) -> CommandEnvelope:
        self.sequence += 1
        return CommandEnvelope(
            command_id=command_id or f"c{self.sequence}",
            client="gateway",
            client_sequence=self.sequence,
            robot_boot_epoch="boot",
            after_state_sequence=self.wait(lambda _: True).sequence,
            issued_at_ns=0,
        )

    def ask(self, verb: Verb, payload: bytes) -> CommandReply:
        return decode(CommandReply, self.bus.query(KEYS.robot_command(verb), payload, WAIT_S).payload)

    def acknowledge(self) -> CommandReply:
        return self.ask("acknowledge_stop", encode(PlainCommand(verb="acknowledge_stop", envelope=self.envelope())))

    def reference(self) -> CommandReply:
        envelope = self.envelope()
        permit = self.permit(envelope, motion="reference", plan_sha256=None, hole_ids=())
        return self.ask("reference", encode(PlainCommand(verb="reference", envelope=envelope, permit=permit)))

    def permit(self, envelope: CommandEnvelope, signer: PermitSigner = SIGNER, **changes: object) -> SignedPermit:
        """What the gateway would sign for this command, but for the changes."""
        usual = {
            "motion": "move",
            "plan_sha256": SHA,
            "hole_ids": ("distal",),
            "case_id": "case1",
            "case_revision": self.case_revision,
            "robot_boot_epoch": envelope.robot_boot_epoch,
            "after_state_sequence": envelope.after_state_sequence,
            "approver": "Dr A",
            "hexapod_sha256": HEXAPOD.sha256,
            "nothing_inside": True,
            "nonce": f"n{next(self._nonces)}",
        }
        return signer.sign(Permit.model_validate(usual | changes))

    def say_case(self, *inside: ObjectInside) -> None:
        """The gateway publishes the open case, and what is in the bone."""
        self.cases.put(encode(CaseContext(case_id="case1", revision=self.case_revision, inside=inside)))

    def make_ready(self) -> None:
        self.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
        assert self.acknowledge().verdict == "accepted"
        self.wait(lambda s: s.state is MotionState.UNREFERENCED and s.locked)
        self.heartbeat()
        wait_for(lambda: self.reference().verdict == "accepted")
        self.wait(lambda s: s.state is MotionState.LOCKED and s.locked and s.referenced)

    def vouch(self, epoch: str, boot_epoch: str = "reg") -> None:
        self.words += 1
        word = RegistrationEpoch(boot_epoch=boot_epoch, sequence=self.words, registration_epoch=epoch)
        self.epochs.put(encode(word))

    def begin_epoch(self, epoch: str, boot_epoch: str = "reg") -> None:
        self.vouch(epoch, boot_epoch)
        self.wait(lambda s: s.registration_epoch == epoch)

    def publish_plan(self, epoch: str = "reg.1", shift_mm: float = 3.0) -> bytes:
        content = encode(plan(epoch, shift_mm))
        self.plans.put(content)
        return content

    def move(
        self, plan_json: bytes, envelope: CommandEnvelope | None = None, permit: SignedPermit | None = None
    ) -> bytes:
        sha256 = hashlib.sha256(plan_json).hexdigest()
        envelope = envelope or self.envelope()
        permit = permit or self.permit(envelope, plan_sha256=sha256)
        return encode(MoveCommand(envelope=envelope, plan_sha256=sha256, permit=permit))

    def ready_with_plan(self) -> bytes:
        self.make_ready()
        self.begin_epoch("reg.1")
        content = self.publish_plan()
        sha256 = hashlib.sha256(content).hexdigest()
        wait_for(lambda: self.service._registration.view.heard_plan(sha256) is not None)
        self.heartbeat()
        return content

    def begin_move(self) -> None:
        reply = self.until_known(self.ready_with_plan())
        assert reply.verdict == "accepted", reply
        self.wait(lambda s: s.state is MotionState.MOVING)
        wait_for(lambda: bool(self.controller.motions))

    def until_known(self, plan_json: bytes) -> CommandReply:
        """Ask for the move; again while plan and heartbeat are still on their way to the robot."""
        deadline = time.monotonic() + WAIT_S
        while True:
            self.heartbeat()
            reply = self.ask("move", self.move(plan_json))
            if reply.code not in ("plan_unknown", "heartbeat_missing") or time.monotonic() > deadline:
                return reply


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, "did not come true in time"
        time.sleep(0.002)


def plan(epoch: str, shift_mm: float) -> Plan:
    correction: Transform[Guide, Guide] = Transform.from_rotvec(np.zeros(3), [shift_mm, 0.0, 0.0])
    top_from_guide = HEXAPOD.top_from_guide(60.0)
    moved = base_from_top(HEXAPOD, ZERO_POSE, HEXAPOD.pivot_mm) @ top_from_guide @ correction @ top_from_guide.inverse()
    target = platform_pose(HEXAPOD, moved, HEXAPOD.pivot_mm)
    lengths = [float(v) for v in leg_lengths_mm(HEXAPOD, target.as_array(), HEXAPOD.pivot_mm)]
    return Plan(
        case_id="case1",
        case_revision=1,
        image_sha256=SHA,
        registration_epoch=epoch,
        robot_boot_epoch="boot",
        hexapod_sha256=HEXAPOD.sha256,
        hole_ids=("distal",),
        head_extension_mm=60.0,
        guide_from_target_guide=matrix4(correction),
        start_pose=message(ZERO_POSE),
        target_pose=message(target),
        pivot_mm=vector3(HEXAPOD.pivot_mm),
        target_leg_lengths_mm=(lengths[0], lengths[1], lengths[2], lengths[3], lengths[4], lengths[5]),
        travel_mm=shift_mm,
        travel_deg=0.0,
        axial_shift_mm=0.0,
        predicted=(),
    )


def message(pose: PlatformPose) -> PlatformPoseMessage:
    x, y, z, u, v, w = (float(value) for value in pose.as_array())
    return PlatformPoseMessage(x_mm=x, y_mm=y, z_mm=z, u_deg=u, v_deg=v, w_deg=w)

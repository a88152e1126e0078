"""The other services, as far as registration sees them, and samples of what they say."""

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from services.registration.state import RegistrationState
from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.errors import ReasonCode
from shared.messages.base import MessageModel, ReasonMessage, decode, encode
from shared.messages.cases import CaseContext, ObjectInside
from shared.messages.imaging import CalibrationMessage, CalibrationValues, FrameHeader, ImageReference
from shared.messages.registration import (
    LocalisationRecord,
    Plan,
    PlanReply,
    PlanRequest,
    VerificationReply,
    VerificationRequest,
)
from shared.messages.robot import MotionState, PlatformPoseMessage, RobotState, StopLatch
from shared.messages.stored_images import LocalisationReply, LocalisationRequest
from shared.parts.canonical import part_sha256
from shared.parts.files import sha256_of
from shared.parts.hexapod_file import hexapod_from_json
from tests.unit.services.registration.rendered_case import (
    GUIDE_JSON,
    HEXAPOD_JSON,
    NAIL_JSON,
    RING_JSON,
    SIZE_PX,
)

PATIENCE_S = 120.0
KEYS = Keys("or1")
CASE = "case-1"
HOME = PlatformPoseMessage(x_mm=0.0, y_mm=0.0, z_mm=0.0, u_deg=0.0, v_deg=0.0, w_deg=0.0)
BLANK = np.ones((SIZE_PX, SIZE_PX), dtype=np.float32)


@dataclass
class Clock:
    """Registration's clock."""

    now_s: float = 100.0


@dataclass
class Outside:
    """The other services, as far as registration sees them."""

    bus: Bus
    state: RegistrationState
    records: "queue.Queue[LocalisationRecord]"
    plans: "queue.Queue[Plan]"
    clock: Clock

    def open_case(
        self,
        revision: int = 1,
        nail_json: str = NAIL_JSON,
        case_id: str | None = CASE,
        inside: tuple[ObjectInside, ...] = (),
    ) -> None:
        context = CaseContext(
            case_id=case_id,
            revision=revision,
            ring_json=RING_JSON,
            guide_json=GUIDE_JSON,
            nail_json=nail_json,
            hexapod_json=HEXAPOD_JSON,
            inside=inside,
        )
        self.bus.retained_publisher(KEYS.case_context).put(encode(context))

    def robot_rests(self, pose: PlatformPoseMessage = HOME) -> None:
        """It is locked, and has been for longer than any image takes to arrive."""
        self.robot_is(pose=pose)
        self.clock.now_s += 1.0

    def robot_is(
        self, state: MotionState = MotionState.LOCKED, pose: PlatformPoseMessage | None = HOME, boot: str = "robot-1"
    ) -> None:
        message = robot_state(state, pose, boot)
        self.bus.retained_publisher(KEYS.robot_state).put(encode(message))
        eventually(lambda: self.state.robot == message)

    def frame(
        self,
        name: str,
        pixels: np.ndarray[tuple[int, ...], np.dtype[np.float32]] = BLANK,
        age_s: float | None = 0.2,
    ) -> None:
        payload = np.ascontiguousarray(pixels, dtype="<f4").tobytes()
        self.bus.publisher(KEYS.frame).put(payload, encode(header(name, age_s)))

    def calibrated(self, name: str, values: CalibrationValues | None, revision: int = 1) -> None:
        self.bus.retained_publisher(KEYS.calibration).put(encode(calibration(name, values, revision)))

    def ask_localisation(self, name: str, values: CalibrationValues | None) -> LocalisationReply:
        request = LocalisationRequest(
            calibration=calibration(name, values), newest=reference(name), open_case_id=CASE, open_case_revision=1
        )
        return decode(LocalisationReply, self._ask(KEYS.localisation_request, request))

    def ask_plan(self, name: str, hole_ids: tuple[str, ...] = ("distal", "proximal")) -> PlanReply:
        request = PlanRequest(case_id=CASE, image_sha256=sha256_of(name.encode()), hole_ids=hole_ids)
        return decode(PlanReply, self._ask(KEYS.plan_request, request))

    def ask_verification(self, *names: str) -> VerificationReply:
        request = VerificationRequest(case_id=CASE, image_sha256=tuple(sha256_of(n.encode()) for n in names))
        return decode(VerificationReply, self._ask(KEYS.verification_request, request))

    def _ask(self, key: str, request: MessageModel) -> bytes:
        return self.bus.query(key, encode(request), PATIENCE_S).payload

    def next_record(self) -> LocalisationRecord:
        return self.records.get(timeout=PATIENCE_S)


def robot_state(state: MotionState, pose: PlatformPoseMessage | None, boot: str = "robot-1") -> RobotState:
    return RobotState(
        boot_epoch=boot,
        sequence=1,
        sent_at_ns=0,
        state=state,
        stop=StopLatch.CLEAR,
        locked=state is MotionState.LOCKED,
        referenced=True,
        pose=pose,
        leg_lengths_mm=None,
        pivot_mm=(0.0, 0.0, 0.0),
        hexapod_sha256=hexapod_from_json(HEXAPOD_JSON.encode()).sha256,
    )


def header(name: str, age_s: float | None = 0.2) -> FrameHeader:
    return FrameHeader(
        sha256=sha256_of(name.encode()),
        sop_instance_uid="1.2.3",
        sequence=1,
        boot_epoch="imaging-1",
        received_at_ns=1,
        width_px=SIZE_PX,
        height_px=SIZE_PX,
        bits_stored=16,
        case_id=CASE,
        case_revision=1,
        nominal_source_to_detector_mm=1000.0,
        nominal_pixel_mm=0.235,
        age_s=age_s,
    )


def calibration(name: str, values: CalibrationValues | None, revision: int = 1) -> CalibrationMessage:
    reasons = () if values else (ReasonMessage(code=ReasonCode.RING_NOT_FOUND, message="no ring; show it"),)
    return CalibrationMessage(
        image=reference(name),
        case_id=CASE,
        case_revision=revision,
        ring_sha256=part_sha256(RING_JSON.encode(), "ring"),
        software_version="0",
        verdict="accepted" if values else "rejected",
        reasons=reasons,
        values=values,
        elapsed_ms=10.0,
    )


def reference(name: str) -> ImageReference:
    return ImageReference(sha256=sha256_of(name.encode()), sop_instance_uid="1.2.3", sequence=1, received_at_ns=1)


def eventually(condition: Callable[[], bool]) -> None:
    """Ask again until it holds: for effects that announce themselves only in answers."""
    pause = threading.Event()
    for _ in range(1000):
        if condition():
            return
        pause.wait(0.01)
    raise AssertionError("never came true")

"""Between the messages of the bus and the values of the core."""

import hashlib
import time
from dataclasses import dataclass

import numpy as np

from services.robot.core.envelope import Envelope
from services.robot.core.motion import stop_is_latched
from services.robot.core.permits import Motion, Permit, PermitRecord, SignatureFailure
from services.robot.core.plans import EpochReport, PlannedMove
from services.robot.core.refusals import Refusal
from services.robot.core.status import DriveStatus
from services.robot.core.stop_result import StopResult
from shared.errors import InputError
from shared.geometry.frames import Guide
from shared.geometry.hexapod import HexapodPart, PlatformPose, leg_lengths_mm
from shared.geometry.transform import Transform
from shared.messages import robot as wire
from shared.messages.base import MessageInvalid, decode, encode
from shared.messages.cases import CaseContext
from shared.messages.geometry import vector3
from shared.messages.permits import Permit as PermitMessage
from shared.messages.permits import SignedPermit
from shared.messages.registration import Plan, RegistrationEpoch
from shared.pki.permit_key import PermitVerifier
from shared.robot_states import MotionState


def envelope(message: wire.CommandEnvelope, effect: str) -> Envelope:
    """A command's envelope; `effect` is what it would do."""
    return Envelope(
        command_id=message.command_id,
        client=message.client,
        client_sequence=message.client_sequence,
        robot_boot_epoch=message.robot_boot_epoch,
        after_state_sequence=message.after_state_sequence,
        time_to_live_s=message.time_to_live_s,
        effect=effect,
    )


def epoch_report(message: RegistrationEpoch, heard_s: float) -> EpochReport:
    """Registration's report of its newest epoch, with the time of its arrival."""
    return EpochReport(message.boot_epoch, message.sequence, message.registration_epoch, heard_s)


def plan_sha256(plan_json: bytes) -> str:
    """Hash of a plan's canonical JSON."""
    return hashlib.sha256(plan_json).hexdigest()


def planned_move(plan_json: bytes) -> PlannedMove:
    """A plan from its canonical JSON.

    Raises
    ------
    InputError
        When it is no plan, or not in canonical form: its hash would then not identify its content.
    """
    plan = decode(Plan, plan_json)
    if encode(plan) != plan_json:
        raise MessageInvalid("the plan is not in canonical form; send it exactly as registration published it")
    try:
        guide_from_target_guide: Transform[Guide, Guide] = Transform.from_matrix(plan.guide_from_target_guide)
    except ValueError as error:
        raise InputError(f"the plan's guide_from_target_guide: {error}") from None
    return PlannedMove(
        sha256=plan_sha256(plan_json),
        hole_ids=plan.hole_ids,
        case_id=plan.case_id,
        case_revision=plan.case_revision,
        registration_epoch=plan.registration_epoch,
        robot_boot_epoch=plan.robot_boot_epoch,
        hexapod_sha256=plan.hexapod_sha256,
        head_extension_mm=plan.head_extension_mm,
        guide_from_target_guide=guide_from_target_guide,
        start_pose=plan.start_pose.value(),
        target_pose=plan.target_pose.value(),
        pivot_mm=np.array(plan.pivot_mm),
        target_leg_lengths_mm=np.array(plan.target_leg_lengths_mm),
    )


def presented_permit(signed: SignedPermit | None, verifier: PermitVerifier) -> Permit | SignatureFailure:
    """What came with a command. Nothing of a permit is read before its signature is known to be the gateway's."""
    if signed is None:
        return SignatureFailure.MISSING
    content = signed.permit_json.encode()
    if hashlib.sha256(content).hexdigest() != signed.permit_sha256:
        return SignatureFailure.ALTERED
    if signed.key_sha256 != verifier.key_sha256:
        return SignatureFailure.OTHER_KEY
    if not verifier.has_signed(signed):
        return SignatureFailure.FORGED
    try:
        message = decode(PermitMessage, content)
    except InputError:
        return SignatureFailure.UNREADABLE
    return Permit(
        motion=Motion(message.motion),
        plan_sha256=message.plan_sha256,
        hole_ids=message.hole_ids,
        case_id=message.case_id,
        case_revision=message.case_revision,
        robot_boot_epoch=message.robot_boot_epoch,
        after_state_sequence=message.after_state_sequence,
        approver=message.approver,
        nothing_inside=message.nothing_inside,
        nonce=message.nonce,
        hexapod_sha256=message.hexapod_sha256,
    )


def inside(context: CaseContext) -> tuple[str, ...]:
    """What is in the guide or the bone, in words."""
    return tuple(f"{found.kind} in {found.hole_id}" for found in context.inside)


@dataclass(frozen=True, slots=True)
class MoveRequest:
    """A move as it is asked for; without a permit from clients of version 1."""

    envelope: Envelope
    plan_sha256: str
    permit: SignedPermit | None


def move_request(payload: bytes) -> MoveRequest:
    """A move of either version; raises `InputError`."""
    try:
        move = decode(wire.MoveCommand, payload)
    except InputError:
        first = _move_request_1(payload)
        if first is None:
            raise
        return first
    return MoveRequest(envelope(move.envelope, f"move {move.plan_sha256}"), move.plan_sha256, move.permit)


def _move_request_1(payload: bytes) -> MoveRequest | None:
    """A move of version 1; None when it is none."""
    try:
        move = decode(wire.MoveCommand1, payload)
    except InputError:
        return None
    plan = move.approval.plan_sha256
    return MoveRequest(envelope(move.envelope, f"move {plan}"), plan, None)


@dataclass(frozen=True, slots=True)
class Publication:
    """What the service adds to a status when it publishes it."""

    boot_epoch: str
    sequence: int
    registration_epoch: str | None
    permits: PermitRecord


def robot_state(status: DriveStatus, hexapod: HexapodPart, published: Publication) -> wire.RobotState:
    """What is published of a status."""
    feedback = status.feedback
    return wire.RobotState(
        boot_epoch=published.boot_epoch,
        sequence=published.sequence,
        sent_at_ns=time.time_ns(),
        clock_s=time.monotonic(),
        state=status.state,
        stop=wire.StopLatch.LATCHED if stop_is_latched(status.state) else wire.StopLatch.CLEAR,
        stop_button=status.stop_button,
        locked=feedback is not None and feedback.locked and status.feedback_generation == status.generation,
        referenced=feedback is not None and feedback.referenced,
        pose=None if feedback is None else wire.PlatformPoseMessage.of(feedback.pose),
        leg_lengths_mm=None if feedback is None else _leg_lengths(hexapod, feedback.pose),
        pivot_mm=vector3(hexapod.pivot_mm),
        hexapod_sha256=hexapod.sha256,
        controller_identity=status.identity,
        registration_epoch=published.registration_epoch,
        command_id=status.command_id,
        outcome=status.outcome,
        deviation_mm=None if status.deviation is None else status.deviation.distance_mm,
        deviation_deg=None if status.deviation is None else status.deviation.angle_deg,
        detail=status.detail,
        permit_sha256=published.permits.taken_sha256,
        permits_refused=published.permits.refused,
        permit_refusal=published.permits.refusal,
    )


def accepted(command_id: str | None, state: MotionState) -> wire.CommandReply:
    """The answer to a command that has begun."""
    return wire.CommandReply(command_id=command_id, verdict="accepted", state=state)


def stopped(result: StopResult, state: MotionState) -> wire.CommandReply:
    """The answer to a stop, with what is known of it."""
    return wire.CommandReply(
        command_id=None,
        verdict="accepted",
        message=result.message,
        state=state,
        stop=wire.StopReport(written=result.written, standstill=result.standstill, locked=result.locked),
    )


def refused(command_id: str | None, refusal: Refusal, state: MotionState) -> wire.CommandReply:
    """The answer to a command that was not carried out."""
    return wire.CommandReply(
        command_id=command_id,
        verdict="refused",
        code=refusal.code.value,
        message=refusal.message,
        state=state,
    )


def _leg_lengths(hexapod: HexapodPart, pose: PlatformPose) -> tuple[float, float, float, float, float, float]:
    lengths = [float(v) for v in leg_lengths_mm(hexapod, pose.as_array(), hexapod.pivot_mm)]
    return (lengths[0], lengths[1], lengths[2], lengths[3], lengths[4], lengths[5])

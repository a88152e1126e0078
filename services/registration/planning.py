"""A plan request in, a plan reply out: is the localisation still what counts, and can the hexapod make the move?

A plan may rest on several images of one set-up. The newest image must be among them, as for a plan from one; the others
must have been made under the same revision of the case with the robot standing in the same place.
"""

from dataclasses import dataclass

import numpy as np

from services.registration.core.fusion_localise import LocalisedImage, fuse_localisations
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.plan import PlannedMove, PlanRefused, PredictedHole, RobotNow, plan_move
from services.registration.head_check import head_trouble
from services.registration.knowledge import (
    POSE_TOLERANCE_DEG,
    POSE_TOLERANCE_MM,
    Knowledge,
    LocalisedFrame,
    OpenCase,
    moved_by,
    pose_at_rest,
    same_place,
)
from services.registration.report import fusion_message, standard_uncertainty
from shared.errors import Reason
from shared.geometry.hexapod import PlatformPose
from shared.messages.base import matrix4, vector3
from shared.messages.registration import Fusion, LocalisationRecord, Plan, PlanReply, PlanRequest, PredictedHoleError
from shared.messages.robot import PlatformPoseMessage, RobotState


@dataclass(frozen=True, slots=True, eq=False)
class _Axes:
    """The holes to plan for, and how the images agree that they rest on; None for one image."""

    holes: tuple[HoleEstimate, ...]
    fusion: Fusion | None


def answer_plan_request(request: PlanRequest, knowledge: Knowledge) -> PlanReply:
    """Plan from the newest accepted localisation, or say why not."""
    case = knowledge.case
    if case is None or case.context.case_id != request.case_id:
        return _refused("no_case", f"case '{request.case_id}' is not the open one; open it and take one more image")
    newest = knowledge.newest_sha256
    if newest is None:
        return _refused("no_localisation", "no image has arrived in this case yet; take one")
    localised = knowledge.localised(request.image_sha256)
    if newest != request.image_sha256 or localised is None:
        return _refused(
            "stale",
            f"a plan needs the newest image {newest[:12]}, localised; asked for was {request.image_sha256[:12]}; "
            "wait for the newest image's localisation and plan from it",
        )
    earlier = _earlier(request, localised, knowledge)
    if isinstance(earlier, PlanReply):
        return earlier
    refusal = _stale_case(localised, case)
    if refusal is not None:
        return refusal
    axes = _axes((*earlier, localised))
    if isinstance(axes, PlanReply):
        return axes
    return (
        _unlike_set_up(localised, knowledge.robot, case)
        or _wrongly_held(localised, knowledge)
        or _planned(request, localised, case, knowledge, axes)
    )


def _wrongly_held(localised: LocalisedFrame, knowledge: Knowledge) -> PlanReply | None:
    trouble = head_trouble(localised, knowledge)
    return None if trouble is None else _refused(trouble.code.value, trouble.message)


def _earlier(
    request: PlanRequest, newest: LocalisedFrame, knowledge: Knowledge
) -> tuple[LocalisedFrame, ...] | PlanReply:
    """The earlier images to fuse, or why one of them is not of the same set-up."""
    hashes = (*request.earlier_image_sha256, request.image_sha256)
    if len(set(hashes)) < len(hashes):
        return _refused("image_twice", f"{len(hashes)} images were named and {len(set(hashes))} differ; name each once")
    found = []
    for sha256 in request.earlier_image_sha256:
        one = knowledge.localised(sha256)
        if one is None:
            return _refused(
                "unknown_image",
                f"image {sha256[:12]} is not among the newest that registration remembers; plan without it",
            )
        why = _another_set_up(one, newest)
        if why is not None:
            return _refused("another_set_up", f"image {sha256[:12]} shows another set-up: {why}; plan without it")
        found.append(one)
    return tuple(found)


def _another_set_up(earlier: LocalisedFrame, newest: LocalisedFrame) -> str | None:
    a, b = earlier.record, newest.record
    if (a.case_id, a.case_revision) != (b.case_id, b.case_revision):
        return f"it was made under revision {a.case_revision} of case '{a.case_id}', the newest under {b.case_revision}"
    if a.robot_pose is None or b.robot_pose is None or a.robot_boot_epoch != b.robot_boot_epoch:
        return "where the robot stood is not known for both"
    if not same_place(a.robot_pose, b.robot_pose):
        moved_mm, moved_deg = moved_by(a.robot_pose, b.robot_pose)
        return (
            f"the robot was moved by {moved_mm:.3f} mm and {moved_deg:.3f}° since (limits {POSE_TOLERANCE_MM:g} mm "
            f"and {POSE_TOLERANCE_DEG:g}°)"
        )
    return None


def _axes(frames: tuple[LocalisedFrame, ...]) -> _Axes | PlanReply:
    """The holes as one accepted image shows them, or several together; or why they may not be planned for."""
    newest = frames[-1].record.localisation
    if len(frames) == 1:
        result = frames[0].result
        if newest.verdict != "accepted" or result is None or result.holes is None:
            reasons = "; ".join(reason.message for reason in newest.reasons)
            return _refused("not_accepted", f"the newest image was rejected: {reasons}")
        return _Axes(result.holes, None)
    fused = fuse_localisations(tuple(_localised_image(frame) for frame in frames), frames[-1].case.parts)
    if fused is None or not fused.shares[-1].used:
        reasons = "; ".join(reason.message for reason in newest.reasons)
        return _refused("not_accepted", f"the newest image cannot be fused with the others: {reasons}")
    if not fused.result.accepted or fused.result.holes is None:
        reasons = "; ".join(reason.message for reason in fused.result.reasons)
        return _refused("not_accepted", f"the {len(frames)} images together were rejected: {reasons}")
    return _Axes(fused.result.holes, fusion_message(fused, tuple(frame.record.localisation for frame in frames)))


def _localised_image(frame: LocalisedFrame) -> LocalisedImage:
    record = frame.record
    reasons = tuple(Reason(reason.code, reason.message) for reason in record.localisation.reasons)
    return LocalisedImage(record.image.sha256[:12], frame.calibration, frame.result, reasons)


def _refused(code: str, message: str) -> PlanReply:
    return PlanReply(verdict="rejected", code=code, message=message)


def _stale_case(localised: LocalisedFrame, case: OpenCase) -> PlanReply | None:
    made = localised.record
    if (made.case_id, made.case_revision) == (case.context.case_id, case.context.revision):
        return None
    return _refused(
        "stale",
        f"the localisation was made under revision {made.case_revision} of the case's set-up, which is now "
        f"{case.context.revision}; take one more image",
    )


def _unlike_set_up(localised: LocalisedFrame, robot: RobotState | None, case: OpenCase) -> PlanReply | None:
    """Why an up-to-date localisation does not show how things stand now, or None."""
    record = localised.record
    pose = pose_at_rest(robot)
    if robot is None or pose is None:
        return _refused("robot_unknown", "the robot's pose is not known or it is moving; wait until it is locked")
    if record.robot_pose is None or record.robot_boot_epoch != robot.boot_epoch:
        return _refused(
            "stale",
            "where the robot stood when the image was made is not certain, for it was moving or had just moved; "
            "take one more image",
        )
    moved_mm, moved_deg = moved_by(record.robot_pose, pose)
    if not same_place(record.robot_pose, pose):
        return _refused(
            "stale",
            f"the robot was moved by {moved_mm:.3f} mm and {moved_deg:.3f}° since the image was made (limits "
            f"{POSE_TOLERANCE_MM:g} mm and {POSE_TOLERANCE_DEG:g}°); take one more image",
        )
    if robot.hexapod_sha256 != case.hexapod.sha256:
        return _refused(
            "hexapod_mismatch",
            f"the case's hexapod file {case.hexapod.sha256[:12]} is not that of the robot service "
            f"{robot.hexapod_sha256[:12]}; give both the same file",
        )
    return None


def _pose(message: PlatformPoseMessage) -> PlatformPose:
    return PlatformPose(message.x_mm, message.y_mm, message.z_mm, message.u_deg, message.v_deg, message.w_deg)


def _planned(
    request: PlanRequest, localised: LocalisedFrame, case: OpenCase, knowledge: Knowledge, axes: _Axes
) -> PlanReply:
    record, robot = localised.record, knowledge.robot
    # `_unlike_set_up` has refused all cases in which one of these is missing
    assert record.robot_pose is not None
    assert record.robot_boot_epoch is not None
    assert robot is not None
    now = RobotNow(case.hexapod, _pose(record.robot_pose), np.array(robot.pivot_mm), case.context.head_extension_mm)
    outcome = plan_move(axes.holes, case.parts.guide, request.hole_ids, now)
    if isinstance(outcome, PlanRefused):
        return _refused(outcome.code.value, outcome.message)
    plan = _plan_message(request, outcome.value, now, record, axes.fusion)
    return PlanReply(verdict="accepted", plan=plan)


def _plan_message(
    request: PlanRequest, move: PlannedMove, now: RobotNow, record: LocalisationRecord, fusion: Fusion | None
) -> Plan:
    legs = [float(v) for v in move.leg_lengths_mm]
    return Plan(
        case_id=request.case_id,
        case_revision=record.case_revision,
        image_sha256=request.image_sha256,
        registration_epoch=record.registration_epoch,
        robot_boot_epoch=record.robot_boot_epoch or "",
        hexapod_sha256=now.hexapod.sha256,
        hole_ids=request.hole_ids,
        head_extension_mm=now.head_extension_mm,
        guide_from_target_guide=matrix4(move.guide_from_target_guide),
        start_pose=_pose_message(now.pose),
        target_pose=_pose_message(move.target_pose),
        pivot_mm=vector3(now.pivot_mm),
        target_leg_lengths_mm=(legs[0], legs[1], legs[2], legs[3], legs[4], legs[5]),
        travel_mm=move.travel_mm,
        travel_deg=move.travel_deg,
        axial_shift_mm=move.axial_shift_mm,
        predicted=tuple(_predicted(hole) for hole in move.predicted),
        fusion=fusion,
    )


def _pose_message(pose: PlatformPose) -> PlatformPoseMessage:
    return PlatformPoseMessage(
        x_mm=pose.x_mm, y_mm=pose.y_mm, z_mm=pose.z_mm, u_deg=pose.u_deg, v_deg=pose.v_deg, w_deg=pose.w_deg
    )


def _predicted(hole: PredictedHole) -> PredictedHoleError:
    return PredictedHoleError(
        id=hole.id,
        offset_mm=hole.offset.entry_mm,
        angle_deg=hole.angle_deg,
        standard_uncertainty=standard_uncertainty(hole.offset),
        chance_to_pass=hole.chance_to_pass,
    )

"""A plan request in, a plan reply out: is the localisation still what counts, and can the hexapod make the move?

What it aims at, and with what, is decided in `plan_axes`: the axes of one image, of several of the same set-up, or of a
verification. The newest image is always among them.
"""

import numpy as np

from services.registration.core.acceptance.plan import PlanRefused
from services.registration.core.plan import PlannedMove, PredictedHole, RobotNow, plan_move
from services.registration.frames import LocalisedFrame, OpenCase
from services.registration.head_check import head_trouble
from services.registration.knowledge import Knowledge
from services.registration.plan_axes import PlanAxes, axes_for, refused
from services.registration.report import standard_uncertainty
from services.registration.robot_pose import POSE_TOLERANCE_DEG, POSE_TOLERANCE_MM, moved_by, pose_at_rest, same_place
from shared.geometry.hexapod import PlatformPose
from shared.messages.base import matrix4, vector3
from shared.messages.registration import LocalisationRecord, Plan, PlanReply, PlanRequest, PredictedHoleError
from shared.messages.robot import PlatformPoseMessage, RobotState


def answer_plan_request(request: PlanRequest, knowledge: Knowledge) -> PlanReply:
    """Plan from the newest accepted localisation, or say why not."""
    case = knowledge.case
    if case is None or case.context.case_id != request.case_id:
        return refused("no_case", f"case '{request.case_id}' is not the open one; open it and take one more image")
    newest = knowledge.newest_sha256
    if newest is None:
        return refused("no_localisation", "no image has arrived in this case yet; take one")
    localised = knowledge.localised(request.image_sha256)
    if newest != request.image_sha256 or localised is None:
        return refused(
            "stale",
            f"a plan needs the newest image {newest[:12]}, localised; asked for was {request.image_sha256[:12]}; "
            "wait for the newest image's localisation and plan from it",
        )
    refusal = _stale_case(localised, case)
    if refusal is not None:
        return refusal
    axes = axes_for(request, localised, knowledge)
    if isinstance(axes, PlanReply):
        return axes
    return (
        _unlike_set_up(localised, knowledge.robot, case)
        or _wrongly_held(localised, knowledge)
        or _planned(request, localised, case, knowledge, axes)
    )


def _wrongly_held(localised: LocalisedFrame, knowledge: Knowledge) -> PlanReply | None:
    trouble = head_trouble(localised, knowledge)
    return None if trouble is None else refused(trouble.code.value, trouble.message)


def _stale_case(localised: LocalisedFrame, case: OpenCase) -> PlanReply | None:
    made = localised.record
    if (made.case_id, made.case_revision) == (case.context.case_id, case.context.revision):
        return None
    return refused(
        "stale",
        f"the localisation was made under revision {made.case_revision} of the case's set-up, which is now "
        f"{case.context.revision}; take one more image",
    )


def _unlike_set_up(localised: LocalisedFrame, robot: RobotState | None, case: OpenCase) -> PlanReply | None:
    """Why an up-to-date localisation does not show how things stand now, or None."""
    record = localised.record
    pose = pose_at_rest(robot)
    if robot is None or pose is None:
        return refused("robot_unknown", "the robot's pose is not known or it is moving; wait until it is locked")
    if record.robot_pose is None or record.robot_boot_epoch != robot.boot_epoch:
        return refused(
            "stale",
            "where the robot stood when the image was made is not certain, for it was moving or had just moved; "
            "take one more image",
        )
    moved_mm, moved_deg = moved_by(record.robot_pose, pose)
    if not same_place(record.robot_pose, pose):
        return refused(
            "stale",
            f"the robot was moved by {moved_mm:.3f} mm and {moved_deg:.3f}° since the image was made (limits "
            f"{POSE_TOLERANCE_MM:g} mm and {POSE_TOLERANCE_DEG:g}°); take one more image",
        )
    if robot.hexapod_sha256 != case.hexapod.sha256:
        return refused(
            "hexapod_mismatch",
            f"the case's hexapod file {case.hexapod.sha256[:12]} is not that of the robot service "
            f"{robot.hexapod_sha256[:12]}; give both the same file",
        )
    return None


def _pose(message: PlatformPoseMessage) -> PlatformPose:
    return PlatformPose(message.x_mm, message.y_mm, message.z_mm, message.u_deg, message.v_deg, message.w_deg)


def _planned(
    request: PlanRequest, localised: LocalisedFrame, case: OpenCase, knowledge: Knowledge, axes: PlanAxes
) -> PlanReply:
    record, robot = localised.record, knowledge.robot
    # `_unlike_set_up` has refused all cases in which one of these is missing
    assert record.robot_pose is not None
    assert record.robot_boot_epoch is not None
    assert robot is not None
    now = RobotNow(case.hexapod, _pose(record.robot_pose), np.array(robot.pivot_mm), case.context.head_extension_mm)
    outcome = plan_move(axes.holes, axes.guide, request.hole_ids, now)
    if isinstance(outcome, PlanRefused):
        return refused(outcome.code.value, outcome.message)
    plan = _plan_message(request, outcome.value, now, record, axes)
    return PlanReply(verdict="accepted", plan=plan)


def _plan_message(
    request: PlanRequest, move: PlannedMove, now: RobotNow, record: LocalisationRecord, axes: PlanAxes
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
        fusion=axes.fusion,
        verified_image_sha256=request.verified_image_sha256,
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
        chance_to_pass=hole.chance_after_move,
    )

"""A plan request in, a plan reply out: is the localisation still valid, and can the hexapod make the move?

The holes to aim at come from the newest image alone, or from several images of one set-up: the others must have been
made under the same revision of the case with the robot standing in the same place. A verification gives both the joint
estimate of the holes from its images, and the wires' axes in the guide: the next move corrects their offsets.
"""

from dataclasses import dataclass, replace

import numpy as np

from services.registration.core.acceptance.criteria import (
    HEAD_NOT_SEEN,
    IMAGE_AGE_UNKNOWN,
    OLDEST_IMAGE,
    HeadTrouble,
    ImageTrouble,
)
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.fusion import fuse_localisations
from services.registration.core.head_check import MotionView, check_motion, check_place
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.localise import LocalisationResult
from services.registration.core.plan import PlannedMove, PredictedHole, RobotNow, plan_move
from services.registration.frames import (
    POSE_TOLERANCE_DEG,
    POSE_TOLERANCE_MM,
    LocalisedFrame,
    OpenCase,
    moved_by,
    pose_at_rest,
    same_place,
)
from services.registration.report import fusion_message, standard_uncertainty
from services.registration.state import RegistrationState
from shared.acceptance import Refusal
from shared.errors import Reason
from shared.geometry.calibration import CArmCalibration
from shared.geometry.hexapod import PlatformPose
from shared.geometry.parts import GuidePart
from shared.messages.geometry import matrix4, vector3
from shared.messages.registration import Fusion, LocalisationRecord, Plan, PlanReply, PlanRequest, PredictedHoleError
from shared.messages.robot import PlatformPoseMessage, RobotState


@dataclass(frozen=True, slots=True, eq=False)
class PlanAxes:
    """The holes to aim at, and the guide that aims."""

    holes: tuple[HoleEstimate, ...]
    guide: GuidePart  # with the wires' axes in place of its holes' after a verification
    fusion: Fusion | None  # how several images agree; None for one image, or a verification


def answer_plan_request(request: PlanRequest, state: RegistrationState, oldest_image_s: float) -> PlanReply:
    """Plan from the newest accepted localisation, or refuse; no image may be older than `oldest_image_s`."""
    case = state.case
    if case is None or case.context.case_id != request.case_id:
        return refused("no_case", f"case '{request.case_id}' is not the open one; open it and take one more image")
    newest = state.newest
    if newest is None:
        return refused("no_localisation", "no image has arrived in this case yet; take one")
    localised = state.images.get(request.image_sha256)
    if newest.sha256 != request.image_sha256 or localised is None:
        return refused(
            "stale",
            f"a plan needs the newest image {newest.sha256[:12]}, localised; asked for was "
            f"{request.image_sha256[:12]}; wait for the newest image's localisation and plan from it",
        )
    refusal = _stale_case(localised, case)
    if refusal is not None:
        return refusal
    aged = _image_age(request, localised, state, oldest_image_s)
    if isinstance(aged, Refusal):
        return refused(aged.code.value, aged.message)
    axes = axes_for(request, localised, state)
    if isinstance(axes, PlanReply):
        return axes
    now = _robot_now(localised, state.robot, case)
    if isinstance(now, PlanReply):
        return now
    outcome = head_trouble(localised, state) or plan_move(axes.holes, axes.guide, request.hole_ids, now)
    if isinstance(outcome, Refusal):
        return refused(outcome.code.value, outcome.message)
    plan = _plan_message(request, outcome.value, now, localised.record, axes)
    return PlanReply(verdict="accepted", plan=plan.model_copy(update={"image_age_s": aged}))


def _image_age(
    request: PlanRequest, newest: LocalisedFrame, state: RegistrationState, oldest_image_s: float
) -> float | Refusal[ImageTrouble]:
    """Age of the oldest image that is named, or why it is too old; images that are not kept are refused later."""
    named = (state.images.get(sha256) for sha256 in (*request.earlier_image_sha256, *request.verified_image_sha256))
    ages = [one.frame.age_s(state.now_s()) for one in (newest, *named) if one is not None]
    known = [age_s for age_s in ages if age_s is not None]
    if len(known) < len(ages):
        return IMAGE_AGE_UNKNOWN.refusal()
    oldest_s = max(known)
    if OLDEST_IMAGE.is_met(oldest_s, oldest_image_s):
        return oldest_s
    quoted = OLDEST_IMAGE.quoted(oldest_s, oldest_image_s)
    return OLDEST_IMAGE.refusal(f"the age of the oldest image that the plan rests on is {quoted}")


def _stale_case(localised: LocalisedFrame, case: OpenCase) -> PlanReply | None:
    made = localised.record
    if (made.case_id, made.case_revision) == (case.context.case_id, case.context.revision):
        return None
    return refused(
        "stale",
        f"the localisation was made under revision {made.case_revision} of the case's set-up, which is now "
        f"{case.context.revision}; take one more image",
    )


def _robot_now(localised: LocalisedFrame, robot: RobotState | None, case: OpenCase) -> RobotNow | PlanReply:
    """The robot as an up-to-date localisation shows it, or why that is not how things stand now."""
    record = localised.record
    pose = pose_at_rest(robot)
    if robot is None or pose is None:
        return refused("robot_unknown", "the robot's pose is not known or it is moving; wait until it is locked")
    elsewhere = stood_elsewhere(localised, robot)
    if elsewhere is not None or record.robot_pose is None:
        return refused("stale", f"{elsewhere}; take one more image")
    if robot.hexapod_sha256 != case.hexapod.sha256:
        return refused(
            "hexapod_mismatch",
            f"the case's hexapod file {case.hexapod.sha256[:12]} is not that of the robot service "
            f"{robot.hexapod_sha256[:12]}; give both the same file",
        )
    return RobotNow(case.hexapod, record.robot_pose.value(), np.array(robot.pivot_mm), case.context.head_extension_mm)


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
        start_pose=PlatformPoseMessage.of(now.pose),
        target_pose=PlatformPoseMessage.of(move.target_pose),
        pivot_mm=vector3(now.pivot_mm),
        target_leg_lengths_mm=(legs[0], legs[1], legs[2], legs[3], legs[4], legs[5]),
        travel_mm=move.travel_mm,
        travel_deg=move.travel_deg,
        axial_shift_mm=move.axial_shift_mm,
        predicted=tuple(_predicted(hole) for hole in move.predicted),
        fusion=axes.fusion,
        verified_image_sha256=request.verified_image_sha256,
    )


def _predicted(hole: PredictedHole) -> PredictedHoleError:
    return PredictedHoleError(
        id=hole.id,
        offset_mm=hole.offset.entry_mm,
        angle_deg=hole.angle_deg,
        standard_uncertainty=standard_uncertainty(hole.offset),
        chance_to_pass=hole.chance_after_move,
    )


def axes_for(request: PlanRequest, newest: LocalisedFrame, state: RegistrationState) -> PlanAxes | PlanReply:
    """What the request asks to plan from, or why that cannot be done."""
    if request.verified_image_sha256:
        return _of_verification(request, newest, state)
    earlier = _earlier(request, newest, state)
    return earlier if isinstance(earlier, PlanReply) else _of_images((*earlier, newest))


def refused(code: str, message: str) -> PlanReply:
    """No plan."""
    return PlanReply(verdict="rejected", code=code, message=message)


def _rejected(what: str, reasons: tuple[Reason, ...]) -> PlanReply:
    return refused("not_accepted", f"{what}: {'; '.join(reason.message for reason in reasons)}")


def _of_verification(request: PlanRequest, newest: LocalisedFrame, state: RegistrationState) -> PlanAxes | PlanReply:
    hashes = request.verified_image_sha256
    if request.image_sha256 not in hashes:
        return refused(
            "stale",
            f"the newest image {request.image_sha256[:12]} is not one of those that were verified; verify with it, or "
            "plan from its localisation",
        )
    verified = state.verified(hashes)
    if verified is None or any(state.images.get(one) is None for one in hashes):
        return refused(
            "unknown_verification", "these images were not verified last, or are not kept any more; verify them again"
        )
    if verified.reasons:
        return _rejected("the verification was rejected", verified.reasons)
    if newest.image.name not in verified.images_used:
        return refused(
            "not_accepted",
            f"the newest image {request.image_sha256[:12]} added nothing to the verification: ring or guide was not "
            "found; take it again, and verify again",
        )
    wires = {wire.hole.id: wire for wire in verified.wires}
    holes = tuple(replace(wire.hole, offset=replace(wire.offset, mean_mm=np.zeros(4))) for wire in verified.wires)
    guide = newest.case.parts.guide
    by_wires = tuple(replace(hole, axis=wires[hole.id].axis_guide) for hole in guide.holes if hole.id in wires)
    return PlanAxes(holes, replace(guide, holes=by_wires), None)


def _earlier(
    request: PlanRequest, newest: LocalisedFrame, state: RegistrationState
) -> tuple[LocalisedFrame, ...] | PlanReply:
    """The earlier images to fuse, or why one of them is not of the same set-up."""
    hashes = (*request.earlier_image_sha256, request.image_sha256)
    if len(set(hashes)) < len(hashes):
        return refused("image_twice", f"{len(hashes)} images were named and {len(set(hashes))} differ; name each once")
    found = []
    for sha256 in request.earlier_image_sha256:
        one = state.images.get(sha256)
        if one is None:
            return refused(
                "unknown_image",
                f"image {sha256[:12]} is not among the newest that registration remembers; plan without it",
            )
        why = another_set_up(one, newest)
        if why is not None:
            return refused("another_set_up", f"image {sha256[:12]} shows another set-up: {why}; plan without it")
        found.append(one)
    return tuple(found)


def another_set_up(earlier: LocalisedFrame, newest: LocalisedFrame) -> str | None:
    """Why two images may not be taken together: another case, or a robot that stood elsewhere; None when they may."""
    a, b = earlier.record, newest.record
    if (a.case_id, a.case_revision) != (b.case_id, b.case_revision):
        return f"it was made under revision {a.case_revision} of case '{a.case_id}', the newest under {b.case_revision}"
    if a.robot_pose is None or b.robot_pose is None or a.robot_boot_epoch != b.robot_boot_epoch:
        return "where the robot stood is not known for both"
    return _moved(a.robot_pose, b.robot_pose, "since")


def stood_elsewhere(localised: LocalisedFrame, robot: RobotState | None) -> str | None:
    """Why the robot may stand elsewhere than when an image was made, as a clause.

    None when it stands there, and when nobody knows where it stands now.
    """
    before, now = localised.record.robot_pose, pose_at_rest(robot)
    if robot is None or now is None:
        return None
    if before is None:
        return (
            "where the robot stood when the image was made is not certain, for it was moving or had just moved, has "
            "moved since imaging received the image, or nobody knows when that was"
        )
    if localised.record.robot_boot_epoch != robot.boot_epoch:
        return "the robot service has been started anew since the image was made"
    return _moved(before, now, "since the image was made")


def _moved(before: PlatformPoseMessage, now: PlatformPoseMessage, since: str) -> str | None:
    """By how much the robot was moved; None when it was not."""
    if same_place(before, now):
        return None
    moved_mm, moved_deg = moved_by(before, now)
    return (
        f"the robot was moved by {moved_mm:.3f} mm and {moved_deg:.3f}° {since} (limits {POSE_TOLERANCE_MM:g} mm "
        f"and {POSE_TOLERANCE_DEG:g}°)"
    )


def _of_images(frames: tuple[LocalisedFrame, ...]) -> PlanAxes | PlanReply:
    """The holes as one accepted image shows them, or several together; or why they may not be planned for."""
    newest = frames[-1].image.result
    if len(frames) == 1:
        if not newest.accepted or newest.holes is None:
            return _rejected("the newest image was rejected", newest.reasons)
        return PlanAxes(newest.holes, frames[0].case.parts.guide, None)
    fused = fuse_localisations(tuple(frame.image for frame in frames), frames[-1].case.parts)
    if fused is None or not fused.shares[-1].used:
        return _rejected("the newest image cannot be fused with the others", newest.reasons)
    if not fused.result.accepted or fused.result.holes is None:
        return _rejected(f"the {len(frames)} images together were rejected", fused.result.reasons)
    agreement = fusion_message(fused, tuple(frame.record.localisation for frame in frames))
    return PlanAxes(fused.result.holes, frames[-1].case.parts.guide, agreement)


def head_trouble(newest: LocalisedFrame, state: RegistrationState) -> Refusal[HeadTrouble] | None:
    """Why the guide seems to be held otherwise than the case states; None when no image contradicts it."""
    # an image of a verification may show no nail, or was not accepted by itself: then one beside it decides
    candidates = (newest, *state.images.accepted_beside(newest))
    view = next((view for one in reversed(candidates) if (view := _view(one)) is not None), None)
    if view is None:
        return HEAD_NOT_SEEN.refusal()
    case = newest.case
    extension_mm, hexapod = case.context.head_extension_mm, case.hexapod
    guide_from_nail = view.ring_from_guide.mean.inverse() @ view.ring_from_nail.mean
    at_rest = check_place(hexapod, view.pose, extension_mm, guide_from_nail, case.context.mount)
    others = map(_view, state.images.accepted_elsewhere(newest))
    moved = (check_motion(hexapod, extension_mm, before, view) for before in others if before is not None)
    return at_rest or next(filter(None, moved), None)


def _view(frame: LocalisedFrame) -> MotionView | None:
    pose = frame.record.robot_pose
    if pose is None or frame.image.calibration is None:
        return None
    return motion_view(pose.value(), frame.image.calibration, frame.image.result)


def motion_view(pose: PlatformPose, calibration: CArmCalibration, result: LocalisationResult) -> MotionView | None:
    """What the checks need of an image; None when guide or nail were not found, or without their errors."""
    if result.guide is None or result.nail is None or result.nail.errors is None:
        return None
    ring_from_camera = calibration.camera_from_ring.inverse()
    return MotionView(
        pose=pose,
        ring_from_guide=PoseEstimate(ring_from_camera @ result.guide.pose.mean, result.guide.pose.errors),
        ring_from_nail=PoseEstimate(ring_from_camera @ result.nail.camera_from_nail, result.nail.errors),
        source_ring_mm=ring_from_camera.translation_mm,
        source_covariance_mm2=calibration.source_covariance_mm2,
    )

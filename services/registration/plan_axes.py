"""What a plan aims at and with what: the nail's holes, and the axes that tools will take through the guide.

The holes come from the newest image alone, or from several images of one set-up: the others must have been made under
the same revision of the case with the robot standing in the same place. A verification gives both: its images' joint
estimate of the holes, and the wires as they lie in the guide. What the wires were off by is the next move.
"""

from dataclasses import dataclass, replace

import numpy as np

from services.registration.core.drill_clearance import AxisOffset
from services.registration.core.fusion import LocalisedImage, fuse_localisations
from services.registration.core.hole_axes import HoleEstimate
from services.registration.frames import LocalisedFrame
from services.registration.knowledge import Knowledge
from services.registration.report import fusion_message
from services.registration.robot_pose import POSE_TOLERANCE_DEG, POSE_TOLERANCE_MM, moved_by, same_place
from shared.errors import Reason
from shared.geometry.parts import GuidePart
from shared.messages.registration import Fusion, PlanReply, PlanRequest


@dataclass(frozen=True, slots=True, eq=False)
class PlanAxes:
    """The holes to aim at, and the guide that aims.

    Attributes
    ----------
    guide
        With the wires' axes in place of its holes' after a verification.
    fusion
        How several images agree; None for one image, or a verification.
    """

    holes: tuple[HoleEstimate, ...]
    guide: GuidePart
    fusion: Fusion | None


def axes_for(request: PlanRequest, newest: LocalisedFrame, knowledge: Knowledge) -> PlanAxes | PlanReply:
    """What the request asks to plan from, or why that cannot be done."""
    if request.verified_image_sha256:
        return _of_verification(request, newest, knowledge)
    earlier = _earlier(request, newest, knowledge)
    return earlier if isinstance(earlier, PlanReply) else _of_images((*earlier, newest))


def verified_name(frame: LocalisedFrame) -> str:
    """What an image is called in a verification."""
    return frame.record.image.sha256[:12]


def refused(code: str, message: str) -> PlanReply:
    """No plan."""
    return PlanReply(verdict="rejected", code=code, message=message)


def _of_verification(request: PlanRequest, newest: LocalisedFrame, knowledge: Knowledge) -> PlanAxes | PlanReply:
    hashes = request.verified_image_sha256
    if request.image_sha256 not in hashes:
        return refused(
            "stale",
            f"the newest image {request.image_sha256[:12]} is not one of those that were verified; verify with it, or "
            "plan from its localisation",
        )
    verified = knowledge.verified(hashes)
    if verified is None:
        return refused("unknown_verification", "these images were not verified last; verify them again")
    if verified.reasons:
        reasons = "; ".join(reason.message for reason in verified.reasons)
        return refused("not_accepted", f"the verification was rejected: {reasons}")
    if verified_name(newest) not in verified.images_used:
        return refused(
            "not_accepted",
            f"the newest image {request.image_sha256[:12]} added nothing to the verification: ring or guide was not "
            "found; take it again, and verify again",
        )
    wires = {wire.hole_id: wire for wire in verified.wires}
    holes = tuple(
        replace(
            wire.hole,
            offset=AxisOffset(np.zeros_like(wire.offset.mean_mm), wire.offset.covariance_mm2, wire.offset.length_mm),
        )
        for wire in verified.wires
    )
    guide = newest.case.parts.guide
    by_wires = tuple(replace(hole, axis=wires[hole.id].axis_guide) for hole in guide.holes if hole.id in wires)
    return PlanAxes(holes, replace(guide, holes=by_wires), None)


def _earlier(
    request: PlanRequest, newest: LocalisedFrame, knowledge: Knowledge
) -> tuple[LocalisedFrame, ...] | PlanReply:
    """The earlier images to fuse, or why one of them is not of the same set-up."""
    hashes = (*request.earlier_image_sha256, request.image_sha256)
    if len(set(hashes)) < len(hashes):
        return refused("image_twice", f"{len(hashes)} images were named and {len(set(hashes))} differ; name each once")
    found = []
    for sha256 in request.earlier_image_sha256:
        one = knowledge.localised(sha256)
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
    if not same_place(a.robot_pose, b.robot_pose):
        moved_mm, moved_deg = moved_by(a.robot_pose, b.robot_pose)
        return (
            f"the robot was moved by {moved_mm:.3f} mm and {moved_deg:.3f}° since (limits {POSE_TOLERANCE_MM:g} mm "
            f"and {POSE_TOLERANCE_DEG:g}°)"
        )
    return None


def _of_images(frames: tuple[LocalisedFrame, ...]) -> PlanAxes | PlanReply:
    """The holes as one accepted image shows them, or several together; or why they may not be planned for."""
    newest = frames[-1].record.localisation
    if len(frames) == 1:
        result = frames[0].result
        if newest.verdict != "accepted" or result is None or result.holes is None:
            reasons = "; ".join(reason.message for reason in newest.reasons)
            return refused("not_accepted", f"the newest image was rejected: {reasons}")
        return PlanAxes(result.holes, frames[0].case.parts.guide, None)
    fused = fuse_localisations(tuple(_localised_image(frame) for frame in frames), frames[-1].case.parts)
    if fused is None or not fused.shares[-1].used:
        reasons = "; ".join(reason.message for reason in newest.reasons)
        return refused("not_accepted", f"the newest image cannot be fused with the others: {reasons}")
    if not fused.result.accepted or fused.result.holes is None:
        reasons = "; ".join(reason.message for reason in fused.result.reasons)
        return refused("not_accepted", f"the {len(frames)} images together were rejected: {reasons}")
    agreement = fusion_message(fused, tuple(frame.record.localisation for frame in frames))
    return PlanAxes(fused.result.holes, frames[-1].case.parts.guide, agreement)


def _localised_image(frame: LocalisedFrame) -> LocalisedImage:
    record = frame.record
    reasons = tuple(Reason(reason.code, reason.message) for reason in record.localisation.reasons)
    return LocalisedImage(record.image.sha256[:12], frame.calibration, frame.result, reasons)

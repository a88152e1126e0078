"""Before a plan: is the guide held as the case says? From the newest image, and from those before the robot's moves."""

from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.head_check import HeadRefused, HeadTrouble, MotionView, check_motion, check_place
from services.registration.core.localise import LocalisationResult
from services.registration.frames import LocalisedFrame
from services.registration.state import RegistrationState
from shared.geometry.calibration import CArmCalibration
from shared.geometry.hexapod import PlatformPose
from shared.messages.robot import PlatformPoseMessage

_NOT_SEEN = (
    "no image with the robot where it stands shows both guide and nail (0 found, 1 needed), so that nobody can tell "
    "whether the guide is held as the case says; take one along the nail's holes and plan again"
)


def head_trouble(newest: LocalisedFrame, state: RegistrationState) -> HeadRefused | None:
    """Why the guide seems to be held otherwise than the case says; None when nothing speaks against it."""
    # an image of a verification may show no nail, or was not accepted by itself: then one beside it must speak
    candidates = (newest, *state.accepted_beside(newest, ()))
    view = next((view for one in reversed(candidates) if (view := _view(one)) is not None), None)
    if view is None:
        return HeadRefused(HeadTrouble.NOT_SEEN, _NOT_SEEN)
    case = newest.case
    extension_mm, hexapod = case.context.head_extension_mm, case.hexapod
    guide_from_nail = view.ring_from_guide.mean.inverse() @ view.ring_from_nail.mean
    refused = check_place(hexapod, view.pose, extension_mm, guide_from_nail, case.context.mount)
    for earlier in state.accepted_elsewhere(newest):
        before = _view(earlier)
        if refused is None and before is not None:
            refused = check_motion(hexapod, extension_mm, before, view)
    return refused


def _view(frame: LocalisedFrame) -> MotionView | None:
    pose = frame.record.robot_pose
    if pose is None or frame.calibration is None or frame.result is None:
        return None
    return motion_view(_pose(pose), frame.calibration, frame.result)


def motion_view(pose: PlatformPose, calibration: CArmCalibration, result: LocalisationResult) -> MotionView | None:
    """What the checks need of an image; None when guide or nail were not found, or without their errors."""
    if result.guide is None or result.nail is None or result.nail.errors is None:
        return None
    ring_from_camera = calibration.camera_from_ring.inverse()
    return MotionView(
        pose=pose,
        ring_from_guide=PoseEstimate.exact(ring_from_camera) @ result.guide.pose,
        ring_from_nail=PoseEstimate(ring_from_camera @ result.nail.camera_from_nail, result.nail.errors),
        source_ring_mm=ring_from_camera.translation_mm,
        source_covariance_mm2=calibration.source_covariance_mm2,
    )


def _pose(message: PlatformPoseMessage) -> PlatformPose:
    return PlatformPose(message.x_mm, message.y_mm, message.z_mm, message.u_deg, message.v_deg, message.w_deg)

"""Whether the robot's head holds the guide as the case states: checked by the first image and by the first move. Pure.

The base is not in the image. But guide and nail are, the controller reports the platform's pose, and the case states
how the head holds the guide: together they give the nail in the base's frame, where the mount can hold it or not
(`check_place`). A head extension that was entered wrong moves it along the head; a guide that was put on turned turns
it.

A move that was commanded for a guide held by X moves a guide that is really held by X E by E^-1 (move) E
(`check_motion`). The rotation part of E turns the move: a guide put on back to front goes to the other side. Its
translation e adds (R - 1) e, R being the move's rotation: 10 mm of head extension are 0.7 mm after a turn of 4 degrees.
Small errors of the head are usual: the check asks whether they explain the observed move, and if not, whether a wrong
extension or a turned guide does. What neither explains (a mount that slipped) is left to the next plan, which starts
from where the newest image shows the guide.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import (
    EXTENSION_BY_PLACE,
    EXTENSION_ERROR,
    EXTENSION_ERROR_SIGMAS,
    GUIDE_TURNED_ON_HEAD,
    MOTION_CHI_SQUARE,
    MOTION_GAIN,
    MOUNT_PLACE,
    HeadTrouble,
)
from services.registration.core.estimation.pose_estimate import Conditioned, PoseEstimate, condition
from services.registration.core.tuning import HEAD_ERRORS
from shared.acceptance import Refusal
from shared.figures import figure
from shared.geometry.frames import Guide, Nail, Ring, RobotBase
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top
from shared.geometry.hexapod_accuracy import MOVE_SD_DEG, MOVE_SD_MM
from shared.geometry.hexapod_mount import MountPlace
from shared.geometry.transform import Transform

# The ways to mount a guide wrongly: half turns about each axis, and quarter turns about the drilling axis.
_TURNS_DEG = ((180, 0, 0), (0, 180, 0), (0, 0, 180), (0, 0, 90), (0, 0, -90))


def check_place(
    hexapod: HexapodPart,
    pose: PlatformPose,
    head_extension_mm: float,
    guide_from_nail: Transform[Guide, Nail],
    mount_name: str,
) -> Refusal[HeadTrouble] | None:
    """Compare where the nail is in the base's frame, for the pose in the image, with where the mount has it."""
    base_from_nail = _base_from_guide(hexapod, head_extension_mm, pose) @ guide_from_nail
    mount = hexapod.mount(mount_name)
    return _turned(base_from_nail, mount) or _displaced(base_from_nail, mount, hexapod, head_extension_mm)


def _base_from_guide(hexapod: HexapodPart, head_extension_mm: float, pose: PlatformPose) -> Transform[RobotBase, Guide]:
    return base_from_top(hexapod, pose, hexapod.pivot_mm) @ hexapod.top_from_guide(head_extension_mm)


def _turned(base_from_nail: Transform[RobotBase, Nail], mount: MountPlace) -> Refusal[HeadTrouble] | None:
    between = mount.base_from_nail.inverse() @ base_from_nail
    turned_deg = float(np.degrees(np.linalg.norm(between.rotation_vector_rad)))
    if turned_deg <= mount.tolerance_deg:
        return None
    return GUIDE_TURNED_ON_HEAD.refusal(
        f"by the image and the head, the nail is turned by {figure(turned_deg, mount.tolerance_deg, 0)}° from where "
        f"mount '{mount.name}' has it (limit {mount.tolerance_deg:g}°)",
    )


def _displaced(
    base_from_nail: Transform[RobotBase, Nail], mount: MountPlace, hexapod: HexapodPart, head_extension_mm: float
) -> Refusal[HeadTrouble] | None:
    off_mm = base_from_nail.translation_mm - mount.base_from_nail.translation_mm
    beyond = np.abs(off_mm) > mount.tolerance_mm
    if not beyond.any():
        return None
    far = ", ".join(
        f"{figure(off, most, 1, '+')} mm along {axis} (limit {most:g} mm)"
        for off, most, axis in zip(off_mm.tolist(), mount.tolerance_mm.tolist(), "xyz", strict=True)
        if abs(off) > most
    )
    fitting_mm = head_extension_mm - float(off_mm[0])
    if not beyond[1:].any() and hexapod.head_extension_mm.contains(fitting_mm):
        return EXTENSION_BY_PLACE.refusal(
            f"by the image and the head, the nail is {far} from where mount '{mount.name}' has it: the head's "
            f"extension was entered as {head_extension_mm:g} mm, {fitting_mm:.0f} mm would fit",
        )
    return MOUNT_PLACE.refusal(f"by the image and the head, the nail is {far} from where mount '{mount.name}' has it")


@dataclass(frozen=True, slots=True, eq=False)
class MotionView:
    """Guide and nail in one image, and where the platform stood."""

    pose: PlatformPose
    ring_from_guide: PoseEstimate[Ring, Guide]
    ring_from_nail: PoseEstimate[Ring, Nail]
    # Focal spot in the ring's frame, shapes (3,) and (3, 3)
    source_ring_mm: NDArray[np.float64]
    source_covariance_mm2: NDArray[np.float64]


def check_motion(
    hexapod: HexapodPart, head_extension_mm: float, before: MotionView, after: MotionView
) -> Refusal[HeadTrouble] | None:
    """Compare the motion between two images with the commanded one.

    None also when the motion was too small to decide, or when no such mistake explains it.
    """
    base_from_guide = _base_from_guide(hexapod, head_extension_mm, before.pose)
    commanded = base_from_guide.inverse() @ _base_from_guide(hexapod, head_extension_mm, after.pose)
    seen = observed_motion(before, after)
    robot = _covariance_of_robot_and_mount(base_from_guide, commanded)
    seen = PoseEstimate(seen.mean, seen.errors.with_more(robot))
    as_filed = _explained(commanded, seen, HEAD_ERRORS.head_sd_mm)
    enough = min(MOTION_CHI_SQUARE.limit.value, as_filed.chi_square - MOTION_GAIN.limit.value)
    extended = _explained(commanded, seen, HEAD_ERRORS.wrong_extension_sd_mm)
    turned = [(turn, _explained(_turned_motion(commanded, turn), seen, HEAD_ERRORS.head_sd_mm)) for turn in _TURNS_DEG]
    turn, best = min(turned, key=lambda one: one[1].chi_square)
    if best.chi_square <= min(enough, extended.chi_square):
        return _guide_turned(turn, commanded, seen, as_filed.chi_square - best.chi_square)
    return _wrong_extension(hexapod, head_extension_mm, extended) if extended.chi_square <= enough else None


def observed_motion(before: MotionView, after: MotionView) -> PoseEstimate[Guide, Guide]:
    """Later guide in the earlier one's frame, against what stands still: the C-arm if it does, else the nail."""
    if c_arm_stood_still(before, after):
        motion = before.ring_from_guide.inverse() @ after.ring_from_guide
        guide_from_nail = after.ring_from_guide.mean.inverse() @ after.ring_from_nail.mean
        nudge = np.radians(HEAD_ERRORS.nudge_sd_deg) * guide_from_nail.adjoint[:, :3]
        return PoseEstimate(motion.mean, motion.errors.with_more(nudge @ nudge.T))
    first = before.ring_from_guide.inverse() @ before.ring_from_nail
    second = after.ring_from_guide.inverse() @ after.ring_from_nail
    return first @ second.inverse()


def c_arm_stood_still(before: MotionView, after: MotionView) -> bool:
    """Whether nail and focal spot are where they were in the ring's frame, within the images' uncertainty.

    The limit is that of six degrees of freedom; of these nine it is exceeded by one still C-arm in a thousand.
    """
    moved = before.ring_from_nail.mean.motion_to(after.ring_from_nail.mean)
    covariance = before.ring_from_nail.covariance + after.ring_from_nail.covariance
    nail = float(moved @ np.linalg.solve(covariance, moved))
    shift_mm = after.source_ring_mm - before.source_ring_mm
    source = float(shift_mm @ np.linalg.solve(before.source_covariance_mm2 + after.source_covariance_mm2, shift_mm))
    return MOTION_CHI_SQUARE.is_met(nail + source)


def _turned_motion(motion: Transform[Guide, Guide], turn_deg: tuple[int, int, int]) -> Transform[Guide, Guide]:
    turn: Transform[Guide, Guide] = Transform.from_rotvec(np.radians(turn_deg), np.zeros(3))
    return turn.inverse() @ motion @ turn


def _explained(
    commanded: Transform[Guide, Guide], observed: PoseEstimate[Guide, Guide], extension_sd_mm: float
) -> Conditioned:
    """By small errors of the head, its extension's error (the fourth) as large as is given."""
    by_head = np.eye(6) - commanded.inverse().adjoint
    along_mm, across_mm = extension_sd_mm, HEAD_ERRORS.head_sd_mm
    head = np.diag([np.radians(HEAD_ERRORS.head_sd_deg)] * 3 + [along_mm, across_mm, across_mm]) ** 2
    return condition(head, commanded.motion_to(observed.mean), by_head, observed.covariance)


def _covariance_of_robot_and_mount(
    base_from_guide: Transform[RobotBase, Guide], commanded: Transform[Guide, Guide]
) -> NDArray[np.float64]:
    """What robot and mount add to a motion, whoever holds the guide, in the later guide's frame, shape (6, 6).

    Tissue pushes back along the travel: the base gives way that way, and turns as the push at the guide makes it.
    """
    robot = np.diag([np.radians(MOVE_SD_DEG)] * 3 + [MOVE_SD_MM] * 3) ** 2
    base_from_later = base_from_guide @ commanded
    place_mm = base_from_later.translation_mm
    travel_mm = place_mm - base_from_guide.translation_mm
    push = np.cross(place_mm, travel_mm) / float(np.linalg.norm(place_mm))
    shift = np.concatenate([np.zeros(3), HEAD_ERRORS.yield_share * travel_mm])
    turn = np.concatenate([np.radians(HEAD_ERRORS.yield_deg_per_mm) * push, np.zeros(3)])
    yields = base_from_later.inverse().adjoint @ np.column_stack([shift, turn])
    return np.asarray(robot + yields @ yields.T)


def _wrong_extension(hexapod: HexapodPart, head_extension_mm: float, found: Conditioned) -> Refusal[HeadTrouble] | None:
    """None unless the error is large, certain, and leads to an extension that the head has."""
    error_mm, sd_mm = float(found.mean[3]), float(np.sqrt(max(found.covariance[3, 3], 0.0)))
    really_mm = head_extension_mm + error_mm
    nearest_mm = float(np.clip(really_mm, hexapod.head_extension_mm.minimum, hexapod.head_extension_mm.maximum))
    least_mm = max(EXTENSION_ERROR.limit.value, EXTENSION_ERROR_SIGMAS.limit.value * sd_mm)
    if abs(really_mm - nearest_mm) > HEAD_ERRORS.beyond_range_sigmas * sd_mm or abs(error_mm) < least_mm:
        return None
    return EXTENSION_ERROR.refusal(
        f"the guide moved as it would with the head's extension at {really_mm:.0f} ± {sd_mm:.0f} mm; entered is "
        f"{head_extension_mm:g} mm, a difference of {EXTENSION_ERROR.quoted(abs(error_mm))}",
    )


def _guide_turned(
    turn_deg: tuple[int, int, int], commanded: Transform[Guide, Guide], seen: PoseEstimate[Guide, Guide], gain: float
) -> Refusal[HeadTrouble]:
    asked, went, angle = commanded.translation_mm, seen.mean.translation_mm, np.linalg.norm(turn_deg)
    return MOTION_GAIN.refusal(
        f"the guide was commanded to move by ({_mm(asked)}) mm along its axes and moved by ({_mm(went)}) mm, as one "
        f"put on the head turned by {angle:.0f}° does: chi-square less by {MOTION_GAIN.quoted(gain)}",
    )


def _mm(values: NDArray[np.float64]) -> str:
    return ", ".join(f"{value:+.1f}" for value in values)

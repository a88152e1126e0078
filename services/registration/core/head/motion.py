"""Whether the guide moved as it was told: what tells a wrong head extension, or a guide put on turned. Pure.

A move that was commanded for a guide held by X moves a guide that is really held by X E by E^-1 (move) E. The rotation
part of E turns the move: a guide put on back to front goes to the other side. Its translation e adds (R - 1) e, R being
the move's rotation: 10 mm of head extension are 0.7 mm after a turn of 4 degrees.

Small errors of the head are usual, and forgiven: the check asks whether the move that was seen can be explained by
them, and if it cannot, whether a wrong extension or a turned guide can. What neither explains (a mount that slipped)
is left to the next plan, which starts from where the newest image shows the guide.
"""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.head.place import HeadRefused, HeadTrouble
from services.registration.core.pose_evidence import cross_matrix
from shared.geometry.frames import Frame, Guide, Nail, Ring
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top
from shared.geometry.hexapod_accuracy import MOVE_SD_DEG, MOVE_SD_MM
from shared.geometry.transform import Transform

To = TypeVar("To", bound=Frame)
From = TypeVar("From", bound=Frame)

# How far heads are off their file, per axis, and how far off a scale may be read.
HEAD_SD_MM, HEAD_SD_DEG = 1.0, 1.0
WRONG_EXTENSION_SD_MM = 10.0
# What a mount gives way to soft tissue that is pushed along: a share of the travel back, and a turn of the base by so
# much for each mm of travel, about the axis that the push asks for.
YIELD_SHARE, YIELD_DEG_PER_MM = 0.03, 0.05
# A C-arm that seems to stand still may have been nudged.
NUDGE_SD_DEG = 0.05
# 6 degrees of freedom: 28 is exceeded once in 10 000 times by chance.
LARGEST_CHI_SQUARE = 28.0
LEAST_GAIN = 16.0
LEAST_EXTENSION_ERROR_MM = 4.0
LEAST_STANDARD_ERRORS = 4.0
_TURNS_DEG = ((180, 0, 0), (0, 180, 0), (0, 0, 180), (0, 0, 90), (0, 0, -90))


@dataclass(frozen=True, slots=True, eq=False)
class MotionView:
    """Guide and nail in one image, and where the platform stood.

    Attributes
    ----------
    guide_covariance, nail_covariance
        Of a small rotation (rad) and translation (mm) in the guide's and the nail's own frame, shape (6, 6).
    source_ring_mm, source_covariance_mm2
        Focal spot in the ring's frame, shapes (3,) and (3, 3).
    """

    pose: PlatformPose
    ring_from_guide: Transform[Ring, Guide]
    guide_covariance: NDArray[np.float64]
    ring_from_nail: Transform[Ring, Nail]
    nail_covariance: NDArray[np.float64]
    source_ring_mm: NDArray[np.float64]
    source_covariance_mm2: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SeenMotion:
    """How the guide moved between two images: the second guide in the frame of the first.

    Attributes
    ----------
    covariance
        Of a small rotation (rad) and translation (mm) in the second guide's frame, shape (6, 6).
    """

    guide_from_later_guide: Transform[Guide, Guide]
    covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Explanation:
    """How well one idea of the head explains a motion; the error of the extension with its standard deviation."""

    chi_square: float
    extension_error_mm: float
    extension_sd_mm: float


def check_motion(
    hexapod: HexapodPart, head_extension_mm: float, before: MotionView, after: MotionView
) -> HeadRefused | None:
    """Compare the motion between two images with what the robot was told.

    Returns
    -------
    HeadRefused or None
        None also when the motion was too small to tell, or when no such mistake explains it.
    """
    commanded = _commanded(hexapod, head_extension_mm, before.pose, after.pose)
    seen = seen_motion(before, after)
    seen = replace(
        seen, covariance=seen.covariance + _beside_the_head(hexapod, head_extension_mm, before.pose, commanded)
    )
    as_filed = _explained(commanded, seen, HEAD_SD_MM)
    enough = min(LARGEST_CHI_SQUARE, as_filed.chi_square - LEAST_GAIN)
    extended = _explained(commanded, seen, WRONG_EXTENSION_SD_MM)
    turned = [(turn, _explained(_conjugated(commanded, turn), seen, HEAD_SD_MM)) for turn in _TURNS_DEG]
    turn, best = min(turned, key=lambda one: one[1].chi_square)
    if best.chi_square <= min(enough, extended.chi_square):
        return _guide_turned(turn, commanded, seen, as_filed)
    if extended.chi_square <= enough and _is_an_extension(hexapod, head_extension_mm, extended):
        return _wrong_extension(head_extension_mm, extended)
    return None


def _is_an_extension(hexapod: HexapodPart, head_extension_mm: float, found: _Explanation) -> bool:
    """Whether the error is large, certain, and leads to an extension that the head has."""
    really_mm = head_extension_mm + found.extension_error_mm
    nearest_mm = float(np.clip(really_mm, hexapod.head_extension_mm.minimum, hexapod.head_extension_mm.maximum))
    possible = abs(really_mm - nearest_mm) <= 2.0 * found.extension_sd_mm
    least_mm = max(LEAST_EXTENSION_ERROR_MM, LEAST_STANDARD_ERRORS * found.extension_sd_mm)
    return possible and abs(found.extension_error_mm) >= least_mm


def seen_motion(before: MotionView, after: MotionView) -> SeenMotion:
    """How the guide moved against what stands still: the C-arm if it does, else the nail."""
    if c_arm_stood_still(before, after):
        motion = before.ring_from_guide.inverse() @ after.ring_from_guide
        back = adjoint(motion.inverse())
        covariance = after.guide_covariance + back @ before.guide_covariance @ back.T
        guide_from_nail = after.ring_from_guide.inverse() @ after.ring_from_nail
        nudge = adjoint(guide_from_nail)[:, :3]
        return SeenMotion(motion, covariance + np.radians(NUDGE_SD_DEG) ** 2 * nudge @ nudge.T)
    first = before.ring_from_guide.inverse() @ before.ring_from_nail
    second = after.ring_from_guide.inverse() @ after.ring_from_nail
    motion = first @ second.inverse()
    back, from_nail = adjoint(motion.inverse()), adjoint(second)
    covariance = after.guide_covariance + back @ before.guide_covariance @ back.T
    return SeenMotion(motion, covariance + from_nail @ (before.nail_covariance + after.nail_covariance) @ from_nail.T)


def c_arm_stood_still(before: MotionView, after: MotionView) -> bool:
    """Whether nail and focal spot are where they were in the ring's frame, as far as the images can tell."""
    between: Transform[Nail, Nail] = before.ring_from_nail.inverse() @ after.ring_from_nail
    moved = _step(between)
    nail = float(moved @ np.linalg.solve(before.nail_covariance + after.nail_covariance, moved))
    shift_mm = after.source_ring_mm - before.source_ring_mm
    source = float(shift_mm @ np.linalg.solve(before.source_covariance_mm2 + after.source_covariance_mm2, shift_mm))
    return nail + source <= LARGEST_CHI_SQUARE


def adjoint(transform: Transform[To, From]) -> NDArray[np.float64]:
    """Small motions in the frame a transform maps from, as motions in the frame it maps to, shape (6, 6)."""
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = transform.rotation
    matrix[3:, :3] = cross_matrix(transform.translation_mm) @ transform.rotation
    return matrix


def _commanded(
    hexapod: HexapodPart, head_extension_mm: float, before: PlatformPose, after: PlatformPose
) -> Transform[Guide, Guide]:
    head = hexapod.top_from_guide(head_extension_mm)
    first, second = (base_from_top(hexapod, pose, hexapod.pivot_mm) @ head for pose in (before, after))
    return first.inverse() @ second


def _conjugated(motion: Transform[Guide, Guide], turn_deg: tuple[int, int, int]) -> Transform[Guide, Guide]:
    turn: Transform[Guide, Guide] = Transform.from_rotvec(np.radians(turn_deg), np.zeros(3))
    return turn.inverse() @ motion @ turn


def _explained(commanded: Transform[Guide, Guide], seen: SeenMotion, extension_sd_mm: float) -> _Explanation:
    """By small errors of the head, its extension's error as large as is given."""
    back = adjoint(commanded.inverse())
    by_head = np.eye(6) - back
    between: Transform[Guide, Guide] = commanded.inverse() @ seen.guide_from_later_guide
    off = _step(between)
    head = np.diag([np.radians(HEAD_SD_DEG)] * 3 + [extension_sd_mm, HEAD_SD_MM, HEAD_SD_MM]) ** 2
    spread = seen.covariance + by_head @ head @ by_head.T
    gain = head @ by_head.T @ np.linalg.inv(spread)
    left = head - gain @ by_head @ head
    return _Explanation(
        float(off @ np.linalg.solve(spread, off)), float((gain @ off)[3]), float(np.sqrt(max(left[3, 3], 0.0)))
    )


def _beside_the_head(
    hexapod: HexapodPart, head_extension_mm: float, start: PlatformPose, commanded: Transform[Guide, Guide]
) -> NDArray[np.float64]:
    """What robot and mount add to a motion, whoever holds the guide, in the later guide's frame, shape (6, 6).

    Tissue pushes back along the travel: the base gives way that way, and turns as the push at the guide makes it.
    """
    robot = np.diag([np.radians(MOVE_SD_DEG)] * 3 + [MOVE_SD_MM] * 3) ** 2
    head = hexapod.top_from_guide(head_extension_mm)
    base_from_guide = base_from_top(hexapod, start, hexapod.pivot_mm) @ head @ commanded
    travel_mm = base_from_guide.translation_mm - (base_from_guide @ commanded.inverse()).translation_mm
    place_mm = base_from_guide.translation_mm
    push = np.cross(place_mm, travel_mm) / float(np.linalg.norm(place_mm))
    shift = np.concatenate([np.zeros(3), YIELD_SHARE * travel_mm])
    turn = np.concatenate([np.radians(YIELD_DEG_PER_MM) * push, np.zeros(3)])
    to_guide = adjoint(base_from_guide.inverse())
    yields = to_guide @ np.column_stack([shift, turn])
    return np.asarray(robot + yields @ yields.T)


def _step(motion: Transform[To, From]) -> NDArray[np.float64]:
    return np.concatenate([motion.rotation_vector_rad, motion.translation_mm])


def _wrong_extension(head_extension_mm: float, found: _Explanation) -> HeadRefused:
    return HeadRefused(
        HeadTrouble.HEAD_EXTENSION,
        f"the guide moved as it would with the head's extension at {head_extension_mm + found.extension_error_mm:.0f} "
        f"± {found.extension_sd_mm:.0f} mm, entered is {head_extension_mm:g} mm (limit {LEAST_EXTENSION_ERROR_MM:g} mm "
        "apart); read its scale again and correct the case, or report step mount_moved if the mount slipped",
    )


def _guide_turned(
    turn_deg: tuple[int, int, int], commanded: Transform[Guide, Guide], seen: SeenMotion, as_filed: _Explanation
) -> HeadRefused:
    told, went = commanded.translation_mm, seen.guide_from_later_guide.translation_mm
    angle = float(np.degrees(Rotation.from_euler("xyz", turn_deg, degrees=True).magnitude()))
    return HeadRefused(
        HeadTrouble.GUIDE_TURNED,
        f"the guide was told to move by ({_mm(told)}) mm along its axes and went by ({_mm(went)}) mm (chi-square "
        f"{as_filed.chi_square:.0f}, limit {LARGEST_CHI_SQUARE:g}), as one put on the head turned by {angle:.0f}° "
        "does; put it on with its distal mark to the distal end, then report step mount_moved",
    )


def _mm(values: NDArray[np.float64]) -> str:
    return ", ".join(f"{value:+.1f}" for value in values)

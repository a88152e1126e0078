"""Accept or reject a calibration: extension, direction and shape of the head, and whether the views agree.

Pure.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from distalock.guide_calibration.hand_eye import GuideCalibration, GuideView, view_residual
from shared.figures import figure
from shared.geometry.frames import Guide, RobotTop
from shared.geometry.hexapod import HexapodPart
from shared.geometry.transform import Transform

# A third of what the suggested poses turn the guide by (22 to 36 degrees): less leaves its place along one axis open.
LEAST_SPREAD_DEG = 8.0
# Views that agree as well as their covariances predict have 1.
LARGEST_NORMALISED_RMS = 2.0
# Five and four times the worst error of 400 calibrations, 0.12 mm and 0.075° (`distalock bench guide_calibration`).
LARGEST_CHECK_MM, LARGEST_CHECK_DEG = 0.6, 0.3
# About three times the error that 95 % of them stay below, 0.067 mm and 0.055°.
LARGEST_SD_MM, LARGEST_SD_DEG = 0.2, 0.15
# Ten times what an accepted calibration leaves open, and more: head and guide are then not as their files describe
# them. A scale in millimetres is read more exactly than that, too.
LARGEST_BEND_MM, LARGEST_BEND_DEG = 2.0, 2.0
LARGEST_EXTENSION_ERROR_MM = 2.0
# Between none and a quarter turn.
TURNED_FROM_DEG = 45.0


class GuideRefusalCode(StrEnum):
    """Why a calibration is refused; stable names."""

    TOO_LITTLE_ROTATION = "too_little_rotation"
    VIEWS_DISAGREE = "views_disagree"
    CHECK_POSE_DIFFERS = "check_pose_differs"
    UNCERTAIN = "uncertain"
    HEAD_EXTENSION = "head_extension"
    GUIDE_TURNED = "guide_turned"
    GUIDE_BENT = "guide_bent"


@dataclass(frozen=True, slots=True)
class GuideRefusal:
    """One reason: stable code, and a sentence with what was measured, the limit and the remedy."""

    code: GuideRefusalCode
    message: str


@dataclass(frozen=True, slots=True)
class HeadSetting:
    """How the head is set, as measured.

    Attributes
    ----------
    extension_mm
        Where along the scale the guide sits best.
    turned_deg
        Angle of the guide against where it should point.
    beside_mm
        What the extension does not explain.
    """

    extension_mm: float
    turned_deg: float
    beside_mm: float


def head_setting(hexapod: HexapodPart, top_from_guide: Transform[RobotTop, Guide]) -> HeadSetting:
    """Read the head's setting from where the guide is."""
    retracted = hexapod.top_from_guide_retracted
    off_mm = top_from_guide.translation_mm - retracted.translation_mm
    between = Rotation.from_matrix(retracted.rotation.T @ top_from_guide.rotation)
    return HeadSetting(float(off_mm[0]), float(np.degrees(between.magnitude())), float(np.linalg.norm(off_mm[1:])))


def check_calibration(
    hexapod: HexapodPart,
    head_extension_mm: float,
    calibration: GuideCalibration,
    views: Sequence[GuideView],
    check: GuideView,
) -> tuple[GuideRefusal, ...]:
    """Reasons against a calibration; empty when it can be used.

    Parameters
    ----------
    check
        A view that the calibration does not rest on.
    """
    # What follows from numbers that mean nothing would only mislead.
    return (
        _spread(views)
        or _agreement(hexapod, calibration, check)
        or _head(head_setting(hexapod, calibration.top_from_guide), head_extension_mm)
    )


def _spread(views: Sequence[GuideView]) -> tuple[GuideRefusal, ...]:
    rotations = Rotation.from_euler("XYZ", [v.pose.as_array()[3:] for v in views], degrees=True)
    vectors = (rotations[0].inv() * rotations).as_rotvec()
    # About the second best axis: rotations about one axis alone leave the place along it open.
    spread_deg = float(np.degrees(np.linalg.svd(vectors - vectors.mean(axis=0), compute_uv=False)[1]))
    if spread_deg >= LEAST_SPREAD_DEG:
        return ()
    return (
        GuideRefusal(
            GuideRefusalCode.TOO_LITTLE_ROTATION,
            f"the poses turn the guide by {figure(spread_deg, LEAST_SPREAD_DEG, 1)}° about a second axis (limit "
            f"{LEAST_SPREAD_DEG:g}°); take images with larger turns about at least two axes",
        ),
    )


def _agreement(hexapod: HexapodPart, calibration: GuideCalibration, check: GuideView) -> tuple[GuideRefusal, ...]:
    if calibration.normalised_rms > LARGEST_NORMALISED_RMS:
        return (
            GuideRefusal(
                GuideRefusalCode.VIEWS_DISAGREE,
                f"the images disagree {figure(calibration.normalised_rms, LARGEST_NORMALISED_RMS, 1)} times more than "
                f"their errors explain (limit {LARGEST_NORMALISED_RMS:g}); see that each image has its own pose, fix "
                "C-arm, mount and guide, and begin again",
            ),
        )
    found = []
    off_mm, off_deg = view_residual(hexapod, calibration, check)
    if off_mm > LARGEST_CHECK_MM or off_deg > LARGEST_CHECK_DEG:
        found.append(
            GuideRefusal(
                GuideRefusalCode.CHECK_POSE_DIFFERS,
                f"in the check pose the guide is {figure(off_mm, LARGEST_CHECK_MM, 2)} mm and "
                f"{figure(off_deg, LARGEST_CHECK_DEG, 2)}° from where the calibration puts it (limits "
                f"{LARGEST_CHECK_MM:g} mm, {LARGEST_CHECK_DEG:g}°); take the images again",
            )
        )
    if calibration.translation_sd_mm > LARGEST_SD_MM or calibration.rotation_sd_deg > LARGEST_SD_DEG:
        found.append(
            GuideRefusal(
                GuideRefusalCode.UNCERTAIN,
                f"the calibration is good to {figure(calibration.translation_sd_mm, LARGEST_SD_MM, 2)} mm and "
                f"{figure(calibration.rotation_sd_deg, LARGEST_SD_DEG, 2)}° (limits {LARGEST_SD_MM:g} mm, "
                f"{LARGEST_SD_DEG:g}°); take more images with larger turns",
            )
        )
    return tuple(found)


def _head(head: HeadSetting, head_extension_mm: float) -> tuple[GuideRefusal, ...]:
    if head.turned_deg > TURNED_FROM_DEG:
        return (
            GuideRefusal(
                GuideRefusalCode.GUIDE_TURNED,
                f"the guide is on the head turned by {head.turned_deg:.0f}°; take it off and put it on with its distal "
                "mark to the distal end",
            ),
        )
    apart_mm = abs(head.extension_mm - head_extension_mm)
    if apart_mm > LARGEST_EXTENSION_ERROR_MM:
        return (
            GuideRefusal(
                GuideRefusalCode.HEAD_EXTENSION,
                f"the head's extension was entered as {head_extension_mm:g} mm, the images show "
                f"{head.extension_mm:.1f} mm, {figure(apart_mm, LARGEST_EXTENSION_ERROR_MM, 1)} mm apart (limit "
                f"{LARGEST_EXTENSION_ERROR_MM:g} mm); read its scale again",
            ),
        )
    if head.beside_mm > LARGEST_BEND_MM or head.turned_deg > LARGEST_BEND_DEG:
        return (
            GuideRefusal(
                GuideRefusalCode.GUIDE_BENT,
                f"the guide is {figure(head.beside_mm, LARGEST_BEND_MM, 1)} mm and "
                f"{figure(head.turned_deg, LARGEST_BEND_DEG, 1)}° from where its head should hold it (limits "
                f"{LARGEST_BEND_MM:g} mm, {LARGEST_BEND_DEG:g}°): head or guide is bent; replace it",
            ),
        )
    return ()

"""Views of a guide that is held in a known way, without noise."""

import numpy as np
from numpy.typing import NDArray

from distalock.guide_calibration.acceptance import GuideRefusalCode, check_calibration
from distalock.guide_calibration.hand_eye import GuideView, calibrate_guide
from shared.geometry.frames import Guide, RobotTop
from shared.geometry.hexapod import PlatformPose, base_from_top
from shared.geometry.transform import Transform
from shared.parts.hexapod_file import default_hexapod

EXTENSION_MM = 60.0
Head = Transform[RobotTop, Guide]

HEXAPOD = default_hexapod()
NOMINAL = HEXAPOD.top_from_guide(EXTENSION_MM)
# What `suggested_poses` gives for nine images, to a tenth: choosing them takes seconds.
POSES = [
    PlatformPose.from_array(values)
    for values in (
        [-18.7, 14.9, 12.4, -14.0, -16.9, 7.9],
        [-7.7, 6.1, 6.3, 21.1, 0.5, 25.9],
        [12.2, 16.8, -15.1, -16.0, 8.8, 13.3],
        [-19.0, -15.6, 12.5, 7.7, -17.4, -16.3],
        [-3.3, 12.5, -0.4, 18.0, 6.5, 26.4],
        [-8.1, -4.5, 15.3, -19.9, -8.8, -24.1],
        [7.3, -17.6, -14.6, 14.9, 9.9, -17.2],
        [0.5, -15.4, -4.1, -18.7, 11.3, -26.4],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    )
]


def exact_views(head: Head, poses: list[PlatformPose]) -> list[GuideView]:
    world: NDArray[np.float64] = Transform.from_rotvec([0.2, -0.1, 0.3], [10.0, 20.0, -300.0]).matrix
    covariance = np.diag([1e-6] * 3 + [1e-4] * 3)
    return [
        GuideView(pose, world @ base_from_top(HEXAPOD, pose, HEXAPOD.pivot_mm).matrix @ head.matrix, covariance)
        for pose in poses
    ]


def turned(rotation_deg: tuple[float, float, float], shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Head:
    off: Transform[Guide, Guide] = Transform.from_rotvec(np.radians(rotation_deg), shift_mm)
    return NOMINAL @ off


def codes(head: Head, views: list[GuideView] | None = None) -> set[GuideRefusalCode]:
    views = views or exact_views(head, POSES)
    found = calibrate_guide(HEXAPOD, views[:-1], NOMINAL)
    return {r.code for r in check_calibration(HEXAPOD, EXTENSION_MM, found, views[:-1], views[-1])}

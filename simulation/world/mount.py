"""A mount that yields: soft tissue pushes the guide back towards where it was mounted, and the base gives way."""

import numpy as np

from shared.geometry.frames import Guide, RobotBase
from shared.geometry.transform import Transform
from simulation.scenario.values import MountYield

_NMM_PER_NM = 1000.0


def yielded_base(
    mount: MountYield, guide_at_rest: Transform[RobotBase, Guide], guide_now: Transform[RobotBase, Guide]
) -> Transform[RobotBase, RobotBase]:
    """How far the base has given way, in its own frame.

    Parameters
    ----------
    guide_at_rest
        Where the guide was when the base was mounted: there nothing pushes.
    guide_now
        Where the robot holds it, as seen from the base.
    """
    force_n = -mount.tissue_n_per_mm * (guide_now.translation_mm - guide_at_rest.translation_mm)
    moment_nmm = np.cross(guide_now.translation_mm, force_n)
    turn_deg = moment_nmm / (mount.rotation_nm_per_deg * _NMM_PER_NM)
    return Transform.from_rotvec(np.radians(turn_deg), force_n / mount.translation_n_per_mm)

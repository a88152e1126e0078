"""Whether the first image shows the robot's base where its mount can hold it. Pure.

The base is not in the image. But guide and nail are, the controller says where the platform stands, and the case says
how the head holds the guide: together they put the nail in the base's frame. A head extension that was read wrong moves
it along the head; a guide that was put on turned turns it.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from shared.figures import figure
from shared.geometry.frames import Guide, Nail, RobotBase
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top
from shared.geometry.hexapod_mount import MountPlace
from shared.geometry.transform import Transform


class HeadTrouble(StrEnum):
    """What is wrong with the head or the mount; stable names."""

    GUIDE_TURNED = "guide_turned"
    HEAD_EXTENSION = "head_extension"
    MOUNT_PLACE = "mount_place"
    NOT_SEEN = "head_not_seen"


@dataclass(frozen=True, slots=True)
class HeadRefused:
    """Why nothing is planned: code and one sentence with figures, limit and remedy."""

    code: HeadTrouble
    message: str


def check_place(
    hexapod: HexapodPart,
    pose: PlatformPose,
    head_extension_mm: float,
    guide_from_nail: Transform[Guide, Nail],
    mount_name: str,
) -> HeadRefused | None:
    """Compare where the nail is in the base's frame with where the mount has it.

    Parameters
    ----------
    pose
        When the image was made.
    mount_name
        `bone` or `nail_head`, as in the case.
    """
    head = hexapod.top_from_guide(head_extension_mm)
    base_from_nail = base_from_top(hexapod, pose, hexapod.pivot_mm) @ head @ guide_from_nail
    mount = hexapod.mount(mount_name)
    return _turned(base_from_nail, mount) or _displaced(base_from_nail, mount, hexapod, head_extension_mm)


def _turned(base_from_nail: Transform[RobotBase, Nail], mount: MountPlace) -> HeadRefused | None:
    between = mount.base_from_nail.inverse() @ base_from_nail
    turned_deg = float(np.degrees(np.linalg.norm(between.rotation_vector_rad)))
    if turned_deg <= mount.tolerance_deg:
        return None
    return HeadRefused(
        HeadTrouble.GUIDE_TURNED,
        f"by the image and the head the nail is turned by {figure(turned_deg, mount.tolerance_deg, 0)}° from where "
        f"mount '{mount.name}' has it (limit {mount.tolerance_deg:g}°); put the guide on the head with its distal mark "
        "to the distal end and its drilling side to the bone, and see that the base points distally",
    )


def _displaced(
    base_from_nail: Transform[RobotBase, Nail], mount: MountPlace, hexapod: HexapodPart, head_extension_mm: float
) -> HeadRefused | None:
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
        return HeadRefused(
            HeadTrouble.HEAD_EXTENSION,
            f"by the image and the head the nail is {far} from where mount '{mount.name}' has it: the head's extension "
            f"was entered as {head_extension_mm:g} mm, {fitting_mm:.0f} mm would fit; read its scale again and correct "
            "the case",
        )
    return HeadRefused(
        HeadTrouble.MOUNT_PLACE,
        f"by the image and the head the nail is {far} from where mount '{mount.name}' has it; see that the mount sits "
        "as designed and that the case names the right mount and the head's extension",
    )

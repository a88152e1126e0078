"""The bones of the virtual operating room. Nothing heavy is imported: options of the command name them."""

from enum import StrEnum


class BoneKind(StrEnum):
    """The bone that is nailed."""

    FEMUR = "femur"
    TIBIA = "tibia"

"""The open case as the other services need to know it: published by the gateway, last value kept for late joiners."""

from typing import Annotated, Literal

from pydantic import Field

from shared.equipment import USUAL_DRILL_DIAMETER_MM, Bone
from shared.messages.base import Finite, Identifier, Message, MessageModel

Side = Literal["left", "right"]
Mount = Literal["bone", "nail_head"]
HeadExtension = Annotated[float, Field(ge=40.0, le=80.0, allow_inf_nan=False)]
DrillDiameter = Annotated[float, Field(ge=1.0, le=10.0, allow_inf_nan=False)]


class ObjectInside(MessageModel):
    """Something that people reported to be in a hole of the guide or the bone."""

    kind: Literal["wire", "drill", "screw"]
    hole_id: str


class CaseContext(Message):
    """Which patient set-up the coming images belong to. Part files travel whole, as their JSON text.

    Attributes
    ----------
    revision
        Counts up with every change of the set-up (another nail, a moved mount, a re-mounted ring): results made under
        an older revision are stale.
    inside
        What is in the guide or the bone: while there is anything, the robot does not move.
    """

    schema_name: Literal["distalock/case-context/1"] = Field("distalock/case-context/1", alias="schema")
    case_id: Identifier | None = Field(description="None when no case is open: images are then kept but not localised.")
    revision: int = Field(ge=0)
    side: Side = "left"
    bone: Bone = "femur"
    mount: Mount = "bone"
    head_extension_mm: HeadExtension = 60.0
    drill_diameter_mm: DrillDiameter = USUAL_DRILL_DIAMETER_MM
    ring_json: str = ""
    guide_json: str = ""
    nail_json: str = ""
    hexapod_json: str = ""
    nominal_source_to_detector_mm: Finite | None = None
    nominal_pixel_mm: Finite | None = None
    inside: tuple[ObjectInside, ...] = ()

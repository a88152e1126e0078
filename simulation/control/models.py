"""Bodies of the control API, on the way in and out."""

from datetime import datetime
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, JsonValue, TypeAdapter

from simulation.room.drilling import Passage, Strike
from simulation.scenario.bones import BoneKind
from simulation.scenario.c_arm_angles import CArmAngles
from simulation.scenario.imaging_values import FlatPanel
from simulation.scenario.values import MountKind, PartSource, Scenario, Side

Vector = tuple[float, float, float]
JsonObject = dict[str, JsonValue]
Angle = Annotated[float, Field(allow_inf_nan=False, ge=-360.0, le=360.0)]
_JSON_OBJECT = TypeAdapter(JsonObject)
HoleName = Annotated[str, Field(min_length=1, max_length=64)]


class Body(BaseModel):
    """Base of every body: frozen, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def vector(values: NDArray[np.float64]) -> Vector:
    """Three plain numbers."""
    x, y, z = (float(v) for v in values)
    return x, y, z


class Health(Body):
    """The process answers."""

    status: Literal["ok"] = "ok"
    simulated: Literal[True] = True


class CaseOfScenario(Body):
    """What the surgeon enters at the console when a case is opened: parts by catalogue name or as in a file."""

    side: Side
    bone: BoneKind
    mount: MountKind
    nail: str | JsonObject
    guide: str | JsonObject
    ring: str | JsonObject
    hexapod: str | JsonObject
    head_extension_mm: float
    nominal_source_to_detector_mm: float
    nominal_pixel_mm: float


class ScenarioBody(Body):
    """What people in the room know of the scenario; nothing of the truth."""

    seed: int
    case: CaseOfScenario
    hole_ids: list[str]
    drill_diameter_mm: float
    detector: Literal["image_intensifier", "flat_panel"]
    part_sha256: dict[str, str]


def scenario_body(scenario: Scenario) -> ScenarioBody:
    """Describe a scenario."""
    parts, sources = scenario.parts, scenario.sources
    case = CaseOfScenario(
        side=scenario.side,
        bone=scenario.bone,
        mount=scenario.mount,
        nail=_part(sources.nail),
        guide=_part(sources.guide),
        ring=_part(sources.ring),
        hexapod=_part(sources.hexapod),
        head_extension_mm=scenario.head_extension_mm,
        nominal_source_to_detector_mm=scenario.c_arm.nominal_source_to_detector_mm,
        nominal_pixel_mm=scenario.c_arm.nominal_pixel_mm,
    )
    return ScenarioBody(
        seed=scenario.seed,
        case=case,
        hole_ids=list(parts.common_hole_ids),
        drill_diameter_mm=scenario.drilling.diameter_mm,
        detector="flat_panel" if isinstance(scenario.detector, FlatPanel) else "image_intensifier",
        part_sha256={
            "ring": parts.ring.sha256,
            "guide": parts.guide.sha256,
            "nail": parts.nail.sha256,
            "hexapod": parts.hexapod.sha256,
        },
    )


def _part(source: PartSource) -> str | JsonObject:
    return source.name if source.in_catalogue else _JSON_OBJECT.validate_json(source.content)


class CArmBody(Body):
    """The C-arm's angles, in degrees."""

    orbital_deg: Angle
    angular_deg: Angle


class CArmTurnBody(Body):
    """Turn source and detector together about the image's x and y axes, right-handed, un-mirrored, in degrees."""

    about_image_x_deg: Annotated[float, Field(allow_inf_nan=False, ge=-90.0, le=90.0)]
    about_image_y_deg: Annotated[float, Field(allow_inf_nan=False, ge=-90.0, le=90.0)]


def c_arm_body(angles: CArmAngles) -> CArmBody:
    """Describe the C-arm's angles."""
    return CArmBody(orbital_deg=angles.orbital_deg, angular_deg=angles.angular_deg)


class ShotBody(Body):
    """A shot that was taken; `delivered_to` is null when no DICOM target is set."""

    number: int
    taken_at: datetime
    sop_instance_uid: str
    sha256: str
    pixel_sha256: str
    c_arm: CArmBody
    delivered_to: str | None


class FluoroscopyBody(Body):
    """Hold the pedal down: so many images at a rate, while the C-arm turns through some places on its way.

    The way is that of the product's advice: about the image's x and y axes, right-handed, un-mirrored, in degrees.
    """

    images: int = Field(30, ge=1, le=120)
    images_per_s: float = Field(10.0, gt=0.0, le=30.0)
    places: int = Field(1, ge=1, le=60)
    about_image_x_deg: Annotated[float, Field(allow_inf_nan=False, ge=-30.0, le=30.0)] = 0.0
    about_image_y_deg: Annotated[float, Field(allow_inf_nan=False, ge=-30.0, le=30.0)] = 0.0


class RunBody(Body):
    """A run that was taken and sent. `late`: images that the target's slowness held up by more than an interval."""

    images: int
    seconds: float
    late: int
    last: ShotBody


class WiresBody(Body):
    """Guide holes to push a wire through; when left out, all that the nail has too."""

    hole_ids: list[HoleName] | None = None


class DrillBody(Body):
    """The guide hole to drill through."""

    hole_id: HoleName


class PassageBody(Body):
    """How a drill or a wire went; `struck` is null when it passed."""

    hole_id: str
    diameter_mm: float
    passed: bool
    entry_offset_mm: float
    exit_offset_mm: float
    angle_deg: float
    clearance_mm: float
    deflection_mm: float
    deflection_deg: float
    struck: Strike | None
    struck_point_nail_mm: Vector | None


def passage_body(passage: Passage) -> PassageBody:
    """Describe a drilling."""
    struck = passage.strike_point_nail_mm
    return PassageBody(
        hole_id=passage.hole_id,
        diameter_mm=passage.rod.diameter_mm,
        passed=passage.passed,
        entry_offset_mm=passage.entry_offset_mm,
        exit_offset_mm=passage.exit_offset_mm,
        angle_deg=passage.angle_deg,
        clearance_mm=passage.clearance_mm,
        deflection_mm=passage.deflection_mm,
        deflection_deg=passage.deflection_deg,
        struck=None if passage.passed else passage.strike,
        struck_point_nail_mm=None if struck is None else vector(struck),
    )


class PassagesBody(Body):
    """Several drills or wires, in order."""

    items: list[PassageBody]

"""The file form of a scenario, `distalock/scenario/1`: a seed, the parts, and ranges that the seed picks from.

A range with equal ends pins a quantity. What a file leaves out comes from `ranges.json`.
"""

import json
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, JsonValue, ValidationError

from shared.errors import InputError
from simulation.scenario.bones import BoneKind
from simulation.scenario.values import MountKind, Side

Number: TypeAlias = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]
Probability: TypeAlias = Annotated[float, Field(ge=0.0, le=1.0)]


def _ordered(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError(f"a range must not run from {ends[0]:g} down to {ends[1]:g}; exchange its ends")
    return ends


Range: TypeAlias = Annotated[tuple[Number, Number], AfterValidator(_ordered)]
PositiveRange: TypeAlias = Annotated[
    tuple[Annotated[float, Field(gt=0.0, le=1e6)], Annotated[float, Field(gt=0.0, le=1e6)]], AfterValidator(_ordered)
]


class ScenarioModel(BaseModel):
    """Base of every section: frozen, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


class PlacementRanges(ScenarioModel):
    """How nail, mount and guide lie. Offsets and tilts of the guide are those of its axes in the home pose."""

    guide_offset_mm: Range
    guide_tilt_deg: Range
    guide_twist_deg: Range
    guide_standoff_mm: PositiveRange
    free_travel_mm: Range
    leg_margin_mm: Number
    joint_margin_deg: Number
    nail_offset_in_bone_mm: Range
    nail_tilt_in_bone_deg: Range
    nail_roll_in_bone_deg: Range
    bone_offset_from_isocentre_mm: Range
    bone_turn_in_room_deg: Range
    start_tilt_deg: Range
    nail_head_mount_probability: Probability


class CArmRanges(ScenarioModel):
    """The C-arm's geometry; errors are relative deviations of the nominal from the true value."""

    source_to_detector_mm: PositiveRange
    source_to_detector_error: Range
    pixel_mm: PositiveRange
    pixel_error: Range
    size_px: Annotated[int, Field(ge=64, le=4096)]
    nail_to_detector_mm: PositiveRange
    roll_deg: Range
    principal_point_offset_mm: Range
    sag_mm_per_90_deg: Range
    ring_gap_mm: PositiveRange
    ring_offset_mm: Range
    ring_tilt_deg: Range


class DetectorRanges(ScenarioModel):
    """Distortion of the image intensifier. Pincushion is the relative stretch at the window's rim."""

    flat_panel_probability: Probability
    pincushion: PositiveRange
    s_shape_mm: Range
    s_shape_width: PositiveRange
    ripple_px: Range
    ripple_wavelength_px: PositiveRange
    shift_mm: Range
    aperture_share: PositiveRange
    s_shape_mm_per_90_deg: Range


class ExposureRanges(ScenarioModel):
    """Tube and detector (see `values.Exposure`)."""

    tube_voltage_kv: PositiveRange
    filtration_mm_aluminium: PositiveRange
    photons_per_px: PositiveRange
    focal_spot_mm: Range
    blur_px: PositiveRange
    tail_px: PositiveRange
    tail_share: Range
    scatter_to_primary: Range
    scatter_mm: PositiveRange
    glare_share: Range
    glare_mm: PositiveRange
    vignetting: Range
    electronic_noise: Range


class DisplayRanges(ScenarioModel):
    """The display (see `values.Display`); quarter turns are always picked at random."""

    mirrored_probability: Probability
    gamma: PositiveRange
    toe: Range
    shoulder: Range
    white_percentile: PositiveRange
    white_level: PositiveRange
    sharpening: Range
    sharpening_px: PositiveRange
    eight_bits_probability: Probability
    twelve_bits_probability: Probability


class CondyleRanges(ScenarioModel):
    """One condyle that is not like the other."""

    centre_x_mm: Range
    back_mm: Range
    length_mm: PositiveRange
    depth_mm: PositiveRange
    width_mm: PositiveRange


class AnatomyRanges(ScenarioModel):
    """Bone and limb (see `values.Anatomy`). Without `far_condyle` both condyles are picked from the same ranges."""

    shaft_half_axis_mm: PositiveRange
    flare_front_back_mm: PositiveRange
    flare_side_mm: PositiveRange
    flare_start_mm: Range
    flare_length_mm: PositiveRange
    cortex_shaft_mm: PositiveRange
    cortex_end_mm: PositiveRange
    condyle_centre_x_mm: Range
    condyle_back_mm: Range
    condyle_length_mm: PositiveRange
    condyle_depth_mm: PositiveRange
    condyle_width_mm: PositiveRange
    condyle_spread_mm: PositiveRange
    spongy_share: Range
    texture_contrast: Range
    thigh_front_back_mm: PositiveRange
    thigh_side_mm: PositiveRange
    thigh_offset_mm: Range
    far_condyle: CondyleRanges | None = None


class DrillingRanges(ScenarioModel):
    """The drill and what it does to the guide."""

    drill_diameter_mm: Annotated[float, Field(gt=0.0, le=20.0)]
    drill_force_n: Range
    nail_head_stiffness_share: Annotated[float, Field(gt=0.0, le=1.0)]


class Ranges(ScenarioModel):
    """Everything a seed picks from."""

    placement: PlacementRanges
    c_arm: CArmRanges
    detector: DetectorRanges
    exposure: ExposureRanges
    display: DisplayRanges
    anatomy: AnatomyRanges
    drilling: DrillingRanges
    head_extension_mm: PositiveRange


class MountYieldFile(ScenarioModel):
    """A mount that yields (see `values.MountYield`)."""

    translation_n_per_mm: Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
    rotation_nm_per_deg: Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
    tissue_n_per_mm: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class ScenarioFile(ScenarioModel):
    """A scenario file. Parts are names of the catalogue or paths relative to the file; the seed picks what is null."""

    schema_name: Literal["distalock/scenario/1"] = Field(alias="schema")
    units: Literal["mm"] = "mm"
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)]
    description: Annotated[str, Field(max_length=500)] = ""
    side: Side | None = None
    bone: BoneKind = BoneKind.FEMUR
    mount: MountKind | None = None
    head_extension_mm: Number | None = None
    ring: str | None = None
    guide: str | None = None
    nail: str | None = None
    hexapod: str | None = None
    mount_yield: MountYieldFile | None = None
    ranges: dict[str, JsonValue] = Field(default_factory=dict)


class ScenarioInvalid(InputError):
    """A scenario file breaks its schema, or its parts cannot be read."""

    code = "scenario_invalid"


def scenario_file_of_seed(seed: int, bone: BoneKind = BoneKind.FEMUR) -> ScenarioFile:
    """The scenario that a seed alone makes, with a bone."""
    return ScenarioFile(schema_name="distalock/scenario/1", seed=seed, bone=bone)


def read_scenario_file(path: Path) -> ScenarioFile:
    """Read a scenario file.

    Raises
    ------
    ScenarioInvalid
        With one sentence that names the file, the place in it and what is wrong.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ScenarioInvalid(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        file = ScenarioFile.model_validate_json(content)
        merged_ranges(file.ranges, file.bone)
    except ValidationError as error:
        raise ScenarioInvalid(f"{path}: {_first(error)}") from None
    return file


def merged_ranges(overrides: dict[str, JsonValue], bone: BoneKind = BoneKind.FEMUR) -> Ranges:
    """A bone's default ranges with some of them replaced; raises pydantic's `ValidationError`."""
    merged = _shipped("ranges.json")
    for changes in (_shipped("tibia.json") if bone is BoneKind.TIBIA else {}, overrides):
        for section, values in changes.items():
            before = merged.get(section)
            if isinstance(values, dict) and isinstance(before, dict):
                merged[section] = {**before, **values}
            else:
                merged[section] = values
    return Ranges.model_validate(merged)


def _shipped(name: str) -> dict[str, JsonValue]:
    content: dict[str, JsonValue] = json.loads(files("simulation.scenario").joinpath(name).read_text(encoding="utf-8"))
    return content


def _first(error: ValidationError) -> str:
    first = error.errors()[0]
    place = ".".join(str(p) for p in first["loc"]) or "file"
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    return f"{place}: {first['msg']}{more}"

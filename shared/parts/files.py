"""Read ring, guide and nail files (JSON, millimetres) and refuse what breaks their schema.

The schemas are contracts with other programs: `distalock/ring/1`, `distalock/guide/1`, `distalock/nail/1`.
"""

import hashlib
from collections import Counter
from collections.abc import Iterable
from itertools import combinations
from pathlib import Path
from typing import Annotated, Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from shared.equipment import Bone
from shared.errors import PartFileInvalid
from shared.geometry.lines import Line, read_only
from shared.geometry.parts import (
    BallPattern,
    Box,
    GuidePart,
    Hole,
    Material,
    NailPart,
    Plate,
    RingPart,
    crossings_of_cylinder,
)

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-2000.0, le=2000.0)]
Positive = Annotated[float, Field(allow_inf_nan=False, gt=0.0, le=500.0)]
NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=500.0)]
Vector = tuple[Finite, Finite, Finite]
Name = Annotated[str, Field(min_length=1, max_length=64)]
Tolerance = Annotated[float, Field(allow_inf_nan=False, gt=0.0, le=1.0)]
ToleranceAngle = Annotated[float, Field(allow_inf_nan=False, gt=0.0, le=5.0)]

# More than any part needs. Identifying a guide compares pairs of balls with pairs of discs: 64 balls that fit nothing
# take 24 s, 100 more than 45 s; a ring of 400 takes 4 s.
MOST_BALLS: Final = 400
_MOST_GUIDE_BALLS: Final = 64
_MOST_BLOCKS, _MOST_HOLES, _MOST_PLATES = 64, 16, 8
_LARGEST_FILE_BYTES: Final = 4 * 2**20
# As many as an image must show (`RING_BALLS_IDENTIFIED`)
_LEAST_RING_BALLS: Final = 16
# A ball is glued into a plate; the plates lie between the detector and the patient.
_BESIDE_PLATE_MM, _DEEPEST_PLATE_MM = 15.0, 400.0
# Directions in files are rounded to two decimals or more.
_LENGTH_ROUNDING: Final = 0.02
_LONGEST_SLOT_MM: Final = 30.0
# Of two axes, between which the least distance is looked for
_PLACES_ALONG_HOLE: Final = 21
_LEAST_ANGLE_TO_NAIL_DEG, _MOST_ANGLE_TO_DRILLING_DEG = 30.0, 100.0


class PartModel(BaseModel):
    """Base of every part file: frozen, no unknown keys, finite numbers, millimetres."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


class BallFile(PartModel):
    """One steel ball."""

    id: Name
    position_mm: Vector
    diameter_mm: Annotated[float, Field(allow_inf_nan=False, ge=0.5, le=10.0)]
    tolerance_mm: Tolerance | None = None


class PlateFile(PartModel):
    """One plate of the ring."""

    z_mm: Finite
    radius_mm: Positive
    thickness_mm: Positive


class HoleFile(PartModel):
    """A hole of a guide or a nail; nails give `position_mm`, guides `point_mm`."""

    id: Name
    direction: Vector
    diameter_mm: Positive

    @model_validator(mode="after")
    def _direction_has_length(self) -> "HoleFile":
        if np.linalg.norm(self.direction) < 1e-6:
            raise ValueError(f"hole '{self.id}' has a direction of length zero")
        return self


class GuideHoleFile(HoleFile):
    """A guide hole."""

    point_mm: Vector


class NailHoleFile(HoleFile):
    """A nail hole.

    `chamfer_mm` is how deep its rims are countersunk at 45 degrees, where the maker says so; `slot_length_mm` the
    length along the nail of an oblong hole, whose width is `diameter_mm`.
    """

    position_mm: Vector
    chamfer_mm: Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=2.0)] | None = None
    slot_length_mm: Annotated[float, Field(allow_inf_nan=False, gt=0.0, le=_LONGEST_SLOT_MM)] | None = None

    @model_validator(mode="after")
    def _slot_is_longer_than_wide(self) -> "NailHoleFile":
        if self.slot_length_mm is not None and self.slot_length_mm <= self.diameter_mm:
            raise ValueError(
                f"the slot of hole '{self.id}' is {self.slot_length_mm:g} mm long and {self.diameter_mm:g} mm wide; "
                "leave slot_length_mm out of a round hole"
            )
        return self


class BoxFile(PartModel):
    """A block of Delrin."""

    centre_mm: Vector
    size_mm: tuple[Positive, Positive, Positive]


class BallsFile(PartModel):
    """What ring and guide files share."""

    units: Literal["mm"]
    name: Name | None = None
    balls: tuple[BallFile, ...] = Field(min_length=4, max_length=MOST_BALLS)
    ball_count: int | None = None
    tolerance_mm: Tolerance | None = None

    @model_validator(mode="after")
    def _count_and_names(self) -> "BallsFile":
        if self.ball_count is not None and self.ball_count != len(self.balls):
            raise ValueError(f"ball_count says {self.ball_count}, the file lists {len(self.balls)} balls")
        _refuse_repeated([b.id for b in self.balls], "ball")
        return self

    def pattern(self) -> BallPattern:
        """The balls as arrays."""
        return BallPattern(
            tuple(b.id for b in self.balls),
            read_only(np.array([b.position_mm for b in self.balls])),
            read_only(np.array([b.diameter_mm for b in self.balls])),
            self._tolerances_mm(),
        )

    def _tolerances_mm(self) -> NDArray[np.float64] | None:
        """Each ball's own tolerance, or the part's; shape (N,), or None where neither is stated of any ball."""
        stated = [self.tolerance_mm if ball.tolerance_mm is None else ball.tolerance_mm for ball in self.balls]
        if all(one is None for one in stated):
            return None
        return read_only(np.array([one or 0.0 for one in stated]))


class RingFile(BallsFile):
    """A calibration ring."""

    schema_name: Literal["distalock/ring/1"] = Field(alias="schema")
    plates: tuple[PlateFile, ...] = Field(min_length=1, max_length=_MOST_PLATES)

    @model_validator(mode="after")
    def _arrangement(self) -> "RingFile":
        if len(self.balls) < _LEAST_RING_BALLS:
            raise ValueError(f"the ring has {len(self.balls)} balls (at least {_LEAST_RING_BALLS} must be identified)")
        heights = sorted(plate.z_mm for plate in self.plates)
        if abs(heights[-1]) > _BESIDE_PLATE_MM or heights[0] < -_DEEPEST_PLATE_MM:
            raise ValueError(
                f"plates at z = {', '.join(f'{z:g}' for z in heights)} mm: the one next to the detector is at z = 0 "
                f"and the others are below it, down to -{_DEEPEST_PLATE_MM:g} (+z points to the detector)"
            )
        for ball in self.balls:
            away = min(abs(ball.position_mm[2] - z) for z in heights)
            if away > _BESIDE_PLATE_MM:
                raise ValueError(
                    f"ball '{ball.id}' is {away:.1f} mm from the nearest plate (limit {_BESIDE_PLATE_MM:g})"
                )
        return self


class GuideFile(BallsFile):
    """A drill guide."""

    schema_name: Literal["distalock/guide/1"] = Field(alias="schema")
    balls: tuple[BallFile, ...] = Field(min_length=4, max_length=_MOST_GUIDE_BALLS)
    holes: tuple[GuideHoleFile, ...] = Field(min_length=1, max_length=_MOST_HOLES)
    body: tuple[BoxFile, ...] = Field((), max_length=_MOST_BLOCKS)
    frame_tolerance_mm: Tolerance | None = None
    frame_tolerance_deg: ToleranceAngle | None = None

    @model_validator(mode="after")
    def _hole_names(self) -> "GuideFile":
        _refuse_repeated([h.id for h in self.holes], "hole")
        return self


class NailFile(PartModel):
    """The distal end of a nail."""

    schema_name: Literal["distalock/nail/1"] = Field(alias="schema")
    units: Literal["mm"]
    name: Name | None = None
    bone: Bone | None = None
    material: Material
    diameter_mm: Positive
    cannulation_diameter_mm: NotNegative
    tip_x_mm: Finite
    holes: tuple[NailHoleFile, ...] = Field(min_length=1, max_length=_MOST_HOLES)
    tolerance_mm: Tolerance | None = None
    tolerance_deg: ToleranceAngle | None = None

    @model_validator(mode="after")
    def _shape(self) -> "NailFile":
        _refuse_repeated([h.id for h in self.holes], "hole")
        for name, value in [("cannulation", self.cannulation_diameter_mm)] + [
            (f"hole '{h.id}'", h.diameter_mm) for h in self.holes
        ]:
            if value >= self.diameter_mm:
                raise ValueError(f"{name} of {value} mm does not fit in a nail of {self.diameter_mm} mm")
        for hole in self.holes:
            _refuse_impossible_direction(hole)
            _refuse_outside(hole, self)
        for one, other in combinations(self.holes, 2):
            _refuse_crossing(one, other, self)
        return self


def _refuse_impossible_direction(hole: NailHoleFile) -> None:
    """Refuse a direction along the nail's axis, against drilling, or not of unit length."""
    length = float(np.linalg.norm(hole.direction))
    if abs(length - 1.0) > _LENGTH_ROUNDING:
        raise ValueError(f"the direction of hole '{hole.id}' has length {length:.3f} (1 within {_LENGTH_ROUNDING:g})")
    x, y, z = np.array(hole.direction) / length
    to_nail, to_drilling = np.degrees(np.arctan2(np.hypot(y, z), abs(x))), np.degrees(np.arctan2(np.hypot(x, y), z))
    if to_nail < _LEAST_ANGLE_TO_NAIL_DEG:
        raise ValueError(
            f"hole '{hole.id}' runs along the nail: {to_nail:.1f}° to its axis, +x (at least "
            f"{_LEAST_ANGLE_TO_NAIL_DEG:g}°)"
        )
    if to_drilling > _MOST_ANGLE_TO_DRILLING_DEG:
        raise ValueError(
            f"hole '{hole.id}' is directed against drilling: {to_drilling:.1f}° to +z (limit "
            f"{_MOST_ANGLE_TO_DRILLING_DEG:g}°)"
        )


def _refuse_outside(hole: NailHoleFile, nail: NailFile) -> None:
    """Refuse a hole that breaks through the nail's side or its end."""
    position, direction = np.array(hole.position_mm), np.array(hole.direction)
    across = direction[1:] / np.linalg.norm(direction[1:])
    beside = abs(float(position[1] * across[1] - position[2] * across[0]))
    room = 0.5 * (nail.diameter_mm - hole.diameter_mm)
    radius = 0.5 * (hole.slot_length_mm or hole.diameter_mm)
    if beside > room:
        raise ValueError(
            f"the axis of hole '{hole.id}' passes the nail's axis at {beside:.2f} mm (limit {room:.2f} in a nail of "
            f"{nail.diameter_mm:g} mm)"
        )
    axis = Line(position, direction)
    ends = crossings_of_cylinder(axis, 0.5 * nail.diameter_mm)
    farthest = max(float(end[0]) for end in ends) + radius
    if farthest > nail.tip_x_mm:
        raise ValueError(f"hole '{hole.id}' reaches x = {farthest:.1f} mm (limit: the nail's end at {nail.tip_x_mm:g})")


def _through_nail(hole: NailHoleFile, nail: NailFile) -> Line:
    """A hole's axis, through the middle of its way in the nail."""
    axis = Line(np.array(hole.position_mm), np.array(hole.direction))
    return Line(np.mean(crossings_of_cylinder(axis, 0.5 * nail.diameter_mm), axis=0), axis.direction)


def _refuse_crossing(one: NailHoleFile, other: NailHoleFile, nail: NailFile) -> None:
    """Refuse holes that run into one another inside the nail."""
    lines = [_through_nail(hole, nail) for hole in (one, other)]
    pieces = [
        line.point_mm
        + np.linspace(-1.0, 1.0, _PLACES_ALONG_HOLE)[:, None]
        * float(np.linalg.norm(np.diff(crossings_of_cylinder(line, 0.5 * nail.diameter_mm), axis=0)) / 2.0)
        * line.direction
        for line in lines
    ]
    apart = float(np.linalg.norm(pieces[0][:, None] - pieces[1], axis=-1).min())
    least = 0.5 * sum(hole.slot_length_mm or hole.diameter_mm for hole in (one, other))
    if apart < least:
        raise ValueError(
            f"holes '{one.id}' and '{other.id}' run into one another: their axes come within {apart:.1f} mm (at least "
            f"{least:.1f}, half of both diameters)"
        )


def _refuse_repeated(names: Iterable[str], kind: str) -> None:
    repeated = sorted(name for name, count in Counter(names).items() if count > 1)
    if repeated:
        raise ValueError(f"{kind} id {repeated[0]!r} appears more than once")


F = TypeVar("F", bound=PartModel)


def parse_part(model: type[F], content: bytes, source: str) -> F:
    """Validate the content of a part file.

    Raises
    ------
    PartFileInvalid
        With one sentence that names the file, the place in it and what is wrong.
    """
    try:
        return model.model_validate_json(content)
    except ValidationError as error:
        faults = error.errors()
        schema = next(
            (fault for fault in faults if fault["loc"] == ("schema",) and fault["type"] == "literal_error"), None
        )
        if schema is not None:
            raise PartFileInvalid(
                f"{source}: its schema is {schema['input']!r}, needed is {schema['ctx']['expected']}; "
                "name another file, or check that no two were swapped"
            ) from None
        first, more = faults[0], f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        place = ".".join(str(p) for p in first["loc"]) or "file"
        message = first["msg"].removeprefix("Value error, ")
        raise PartFileInvalid(f"{source}: {place}: {message}{more}; correct the file, or name another") from None


def ring_from_json(content: bytes, source: str = "ring file") -> RingPart:
    """Read a ring file's content; raises `PartFileInvalid`."""
    file = parse_part(RingFile, content, source)
    plates = tuple(Plate(p.z_mm, p.radius_mm, p.thickness_mm) for p in file.plates)
    return RingPart(file.pattern(), plates, hash_of(file))


def guide_from_json(content: bytes, source: str = "guide file") -> GuidePart:
    """Read a guide file's content; raises `PartFileInvalid`."""
    file = parse_part(GuideFile, content, source)
    holes = tuple(Hole(h.id, Line(np.array(h.point_mm), np.array(h.direction)), h.diameter_mm) for h in file.holes)
    body = tuple(Box(b.centre_mm, b.size_mm) for b in file.body)
    return GuidePart(file.pattern(), holes, body, hash_of(file), file.frame_tolerance_mm, file.frame_tolerance_deg)


def nail_from_json(content: bytes, source: str = "nail file") -> NailPart:
    """Read a nail file's content; raises `PartFileInvalid`."""
    file = parse_part(NailFile, content, source)
    holes = tuple(Hole(h.id, _through_nail(h, file), h.diameter_mm, h.chamfer_mm, h.slot_length_mm) for h in file.holes)
    return NailPart(
        file.material,
        file.diameter_mm,
        file.cannulation_diameter_mm,
        file.tip_x_mm,
        holes,
        hash_of(file),
        file.tolerance_mm,
        file.tolerance_deg,
        bone=file.bone,
    )


def read_part_file(path: Path) -> bytes:
    """Bytes of a part file; raises `PartFileInvalid` when it cannot be read."""
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST_FILE_BYTES + 1)
    except OSError as error:
        raise PartFileInvalid(f"{path}: cannot be read: {error.strerror or error}; check its name") from None
    if len(content) > _LARGEST_FILE_BYTES:
        raise PartFileInvalid(f"{path}: more than {_LARGEST_FILE_BYTES} bytes are no part file; name another")
    return content


def canonical_text(file: PartModel) -> bytes:
    """A part file without what says nothing: no spaces, keys in the schema's order, nothing that was left out."""
    return file.model_dump_json(by_alias=True, exclude_none=True).encode()


def hash_of(file: PartModel) -> str:
    """The part's hash: that of its canonical text, so that two files that say the same have the same."""
    return sha256_of(canonical_text(file))


def sha256_of(content: bytes) -> str:
    """Hexadecimal SHA-256."""
    return hashlib.sha256(content).hexdigest()

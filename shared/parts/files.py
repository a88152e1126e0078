"""Read ring, guide and nail files (JSON, millimetres) and refuse what breaks their schema.

The schemas are contracts with other programs: `distalock/ring/1`, `distalock/guide/1`, `distalock/nail/1`.
"""

import hashlib
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from shared.errors import PartFileInvalid
from shared.geometry.lines import Line, read_only
from shared.geometry.parts import BallPattern, Box, GuidePart, Hole, Material, NailPart, Plate, RingPart

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-2000.0, le=2000.0)]
Positive = Annotated[float, Field(allow_inf_nan=False, gt=0.0, le=500.0)]
NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=500.0)]
Vector = tuple[Finite, Finite, Finite]
Name = Annotated[str, Field(min_length=1, max_length=64)]


class PartModel(BaseModel):
    """Base of every part file: frozen, no unknown keys, finite numbers, millimetres."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


class BallFile(PartModel):
    """One steel ball."""

    id: Name
    position_mm: Vector
    diameter_mm: Positive


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
    """A nail hole; `chamfer_mm` is how deep its rims are countersunk at 45 degrees, where the maker says so."""

    position_mm: Vector
    chamfer_mm: Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=2.0)] | None = None


class BoxFile(PartModel):
    """A block of Delrin."""

    centre_mm: Vector
    size_mm: tuple[Positive, Positive, Positive]


class BallsFile(PartModel):
    """What ring and guide files share."""

    units: Literal["mm"]
    name: Name | None = None
    balls: tuple[BallFile, ...] = Field(min_length=4)
    ball_count: int | None = None

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
        )


class RingFile(BallsFile):
    """A calibration ring."""

    schema_name: Literal["distalock/ring/1"] = Field(alias="schema")
    plates: tuple[PlateFile, ...] = Field(min_length=1)


class GuideFile(BallsFile):
    """A drill guide."""

    schema_name: Literal["distalock/guide/1"] = Field(alias="schema")
    holes: tuple[GuideHoleFile, ...] = Field(min_length=1)
    body: tuple[BoxFile, ...] = ()

    @model_validator(mode="after")
    def _hole_names(self) -> "GuideFile":
        _refuse_repeated([h.id for h in self.holes], "hole")
        return self


class NailFile(PartModel):
    """The distal end of a nail."""

    schema_name: Literal["distalock/nail/1"] = Field(alias="schema")
    units: Literal["mm"]
    name: Name | None = None
    material: Material
    diameter_mm: Positive
    cannulation_diameter_mm: NotNegative
    tip_x_mm: Finite
    holes: tuple[NailHoleFile, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _shape(self) -> "NailFile":
        _refuse_repeated([h.id for h in self.holes], "hole")
        for name, value in [("cannulation", self.cannulation_diameter_mm)] + [
            (f"hole '{h.id}'", h.diameter_mm) for h in self.holes
        ]:
            if value >= self.diameter_mm:
                raise ValueError(f"{name} of {value} mm does not fit in a nail of {self.diameter_mm} mm")
        return self


def _refuse_repeated(names: list[str], kind: str) -> None:
    repeated = sorted({n for n in names if names.count(n) > 1})
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
    return RingPart(file.pattern(), plates, sha256_of(content))


def guide_from_json(content: bytes, source: str = "guide file") -> GuidePart:
    """Read a guide file's content; raises `PartFileInvalid`."""
    file = parse_part(GuideFile, content, source)
    holes = tuple(Hole(h.id, Line(np.array(h.point_mm), np.array(h.direction)), h.diameter_mm) for h in file.holes)
    body = tuple(Box(b.centre_mm, b.size_mm) for b in file.body)
    return GuidePart(file.pattern(), holes, body, sha256_of(content))


def nail_from_json(content: bytes, source: str = "nail file") -> NailPart:
    """Read a nail file's content; raises `PartFileInvalid`."""
    file = parse_part(NailFile, content, source)
    holes = tuple(
        Hole(h.id, Line(np.array(h.position_mm), np.array(h.direction)), h.diameter_mm, h.chamfer_mm)
        for h in file.holes
    )
    return NailPart(
        file.material, file.diameter_mm, file.cannulation_diameter_mm, file.tip_x_mm, holes, sha256_of(content)
    )


def read_part_file(path: Path) -> bytes:
    """Bytes of a part file; raises `PartFileInvalid` when it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise PartFileInvalid(f"{path}: cannot be read: {error.strerror or error}; check its name") from None


def sha256_of(content: bytes) -> str:
    """Hexadecimal SHA-256."""
    return hashlib.sha256(content).hexdigest()

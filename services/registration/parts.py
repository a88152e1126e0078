"""Read the parts a localisation needs, and refuse those it could not use."""

from services.registration.core.localise import Parts
from shared.errors import PartFileInvalid
from shared.geometry.parts import NailPart, hole_surface_points
from shared.parts.files import guide_from_json, nail_from_json, ring_from_json


def parts_from_json(
    ring: bytes,
    guide: bytes,
    nail: bytes,
    drill_diameter_mm: float,
    sources: tuple[str, str, str] = ("ring file", "guide file", "nail file"),
) -> Parts:
    """Parse ring, guide and nail files.

    Raises `PartFileInvalid` when a file breaks its schema, or a hole of the nail does not cross the nail.
    """
    parts = Parts(
        ring_from_json(ring, sources[0]),
        guide_from_json(guide, sources[1]),
        nail_from_json(nail, sources[2]),
        drill_diameter_mm,
    )
    _require_crossing_holes(parts.nail, sources[2])
    return parts


def _require_crossing_holes(nail: NailPart, source: str) -> None:
    for hole in nail.holes:
        try:
            hole_surface_points(nail, hole)
        except ValueError as error:
            raise PartFileInvalid(f"{source}: {error}; correct its position or direction") from None

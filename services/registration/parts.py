"""Read the parts a localisation needs."""

from services.registration.core.localise import Parts
from shared.parts.files import guide_from_json, nail_from_json, ring_from_json


def parts_from_json(
    ring: bytes,
    guide: bytes,
    nail: bytes,
    drill_diameter_mm: float,
    sources: tuple[str, str, str] = ("ring file", "guide file", "nail file"),
) -> Parts:
    """Parse ring, guide and nail files; raises `PartFileInvalid` when a file breaks its schema."""
    return Parts(
        ring_from_json(ring, sources[0]),
        guide_from_json(guide, sources[1]),
        nail_from_json(nail, sources[2]),
        drill_diameter_mm,
    )

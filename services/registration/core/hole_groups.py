"""Which of a nail's holes an image along the guide's holes can show: those that run in about their direction."""

from dataclasses import replace

import numpy as np

from services.registration.core.tuning import HOLE_GROUPS
from shared.geometry.lines import angle_between_rad
from shared.geometry.parts import GuidePart, Hole, NailPart


def holes_of_guide(nail: NailPart, guide: GuidePart) -> NailPart:
    """The nail with the holes that are localised for a guide; all others are `NailPart.other_holes`.

    An image shows holes of one direction only: that of the first hole that has a namesake in the guide, or of the first
    of all. The guide is mounted for it, and so its file decides, not the image.
    """
    named = {hole.id for hole in guide.holes}
    first = next((hole for hole in nail.holes if hole.id in named), nail.holes[0])

    def together(hole: Hole) -> bool:
        apart_deg = float(np.degrees(angle_between_rad(hole.axis.direction, first.axis.direction)))
        return apart_deg <= (HOLE_GROUPS.named_apart_deg if hole.id in named else HOLE_GROUPS.apart_deg)

    others = tuple(hole for hole in nail.holes if not together(hole))
    return replace(nail, holes=tuple(filter(together, nail.holes)), other_holes=nail.other_holes + others)

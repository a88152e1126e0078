"""Whether there is a wire in a hole of the guide, and where."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.passing import across_basis
from services.registration.core.wires.fit import LEAST_SEEN_PX, LEAST_SEEN_SHARE, WireFit, fit_wire, seen_share
from services.registration.core.wires.model import Passage, endings, wire_model
from services.registration.core.wires.view import PreparedView
from shared.errors import Reason, ReasonCode
from shared.figures import figure
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import read_only, unit
from shared.geometry.parts import GuidePart, Hole, NailPart, hole_surface_points
from shared.geometry.transform import Transform

WIRE_DIAMETER_MM = 2.0
_LEAST_DARKNESS = 0.5


def find_wire(
    views: tuple[PreparedView, ...],
    guide: GuidePart,
    guide_hole: Hole,
    nail: NailPart,
    guide_from_nail: Transform[Guide, Nail],
    known: NDArray[np.float64],
) -> WireFit | Reason:
    """The wire through one guide hole, or why there is none to be seen.

    Parameters
    ----------
    guide_hole
        The nail has one of the same id.
    known
        Covariance of guide and nail, as `SetUp.covariance`.
    """
    nail_hole = next(hole for hole in nail.holes if hole.id == guide_hole.id)
    entry_mm = guide_from_nail @ hole_surface_points(nail, nail_hole)[0]
    along_mm = float((entry_mm - guide_hole.axis.point_mm) @ guide_hole.axis.direction)
    ways = endings(_passage(guide_hole, nail, nail_hole, entry_mm, guide_from_nail))
    models = tuple(wire_model(guide, guide_hole, WIRE_DIAMETER_MM, along_mm, ending) for ending in ways)
    fit = fit_wire(views, models, known)
    seen = sum(fit.seen_px)
    fraction = seen_share(fit.seen_px, fit.free_px)
    if seen >= LEAST_SEEN_PX and fraction >= LEAST_SEEN_SHARE and fit.darkness >= _LEAST_DARKNESS:
        return fit
    darkness = 100.0 * max(fit.darkness, 0.0)
    return Reason(
        ReasonCode.WIRE_NOT_FOUND,
        f"no wire was found through guide hole '{guide_hole.id}': {figure(seen, LEAST_SEEN_PX, 0)} px of its outline "
        f"were seen (limit {LEAST_SEEN_PX:.0f}), {figure(100.0 * fraction, 100.0 * LEAST_SEEN_SHARE, 0)} % of what is "
        f"not hidden (limit {100.0 * LEAST_SEEN_SHARE:.0f} %), {figure(darkness, 100.0 * _LEAST_DARKNESS, 0)} % as "
        f"dark as the nail (limit {100.0 * _LEAST_DARKNESS:.0f} %); insert the wire up to the nail, or take an "
        "oblique image",
    )


def _passage(
    guide_hole: Hole,
    nail: NailPart,
    nail_hole: Hole,
    entry_guide_mm: NDArray[np.float64],
    guide_from_nail: Transform[Guide, Nail],
) -> Passage:
    across = across_basis(guide_hole.axis.direction)
    beside = across @ np.cross(guide_hole.axis.direction, guide_from_nail.directions(np.array([1.0, 0.0, 0.0])))
    return Passage(
        read_only(across @ (entry_guide_mm - guide_hole.axis.point_mm)),
        0.5 * (nail_hole.diameter_mm - WIRE_DIAMETER_MM),
        read_only(unit(beside)),
        nail.radius_mm + 0.5 * WIRE_DIAMETER_MM,
    )

"""Outlines of wires: whole around what is seen end on, and with a likelihood that does not jump as a wire moves."""

import numpy as np
import pytest

from services.registration.core.drill_clearance import across_basis
from services.registration.core.tuning import WIRE_VISIBILITY
from services.registration.core.wires.fit import NAIL_UNKNOWNS, WireProblem
from services.registration.core.wires.image import gradient_image
from services.registration.core.wires.model import TIP, wire_model
from services.registration.core.wires.outline import IMAGE_UNKNOWNS, CrossSections, outline_of
from tests.unit.services.registration.core.wires.wire_scene import ASKEW, GUIDE_FROM_NAIL, joint, oblique, view_of
from tests.unit.services.registration.xray_scene import guide_part, nail_part

REACH_DETECTOR_MM = 0.5875


def sections(way_px: float, growth_px: float, discs: int = 60) -> CrossSections:
    """Discs of 10 px radius and more, in a row to the right."""
    centre = np.column_stack([np.linspace(0.0, way_px, discs), np.zeros(discs)])
    return CrossSections(100.0 + centre, 10.0 + np.linspace(0.0, growth_px, discs))


def test_outline_of_a_long_wire_is_two_sides_and_two_half_circles() -> None:
    outline = outline_of(sections(200.0, 0.0))
    assert outline.length_px.sum() == pytest.approx(2.0 * 200.0 + 2.0 * np.pi * 10.0, rel=0.02)
    away = np.linalg.norm(outline.point_px - sections(200.0, 0.0).centre_px[outline.section], axis=1)
    assert away == pytest.approx(10.0)


def test_seen_end_on_the_larger_end_is_all_of_the_outline() -> None:
    outline = outline_of(sections(2.0, 3.0))
    drawn = outline.length_px > 0.0
    assert set(outline.section[drawn]) == {59}
    assert outline.length_px.sum() == pytest.approx(2.0 * np.pi * 13.0)


def test_outline_does_not_jump_while_a_wire_turns_end_on() -> None:
    lengths = [outline_of(sections(way_px, 3.0)).length_px.sum() for way_px in np.linspace(2.8, 60.0, 800)]
    assert np.abs(np.diff(lengths)).max() < 0.02 * np.ptp(lengths)


def test_likelihood_hardly_changes_with_the_points_that_are_read() -> None:
    guide, nail = guide_part(), nail_part()
    view = view_of(oblique(38.0), ASKEW, seed=61)
    prepared = (gradient_image(view, guide, nail, GUIDE_FROM_NAIL, WIRE_VISIBILITY.margin_detector_mm),)
    model = wire_model(guide, guide.holes[0], 2.0, 110.0, None)
    problem = WireProblem.of(prepared, model, joint(view).covariance)
    state = np.concatenate([model.mean, np.zeros(IMAGE_UNKNOWNS + NAIL_UNKNOWNS)])
    across = across_basis(guide.holes[0].axis.direction)[:, :2]
    state[:4] = (ASKEW.offsets_mm[guide.holes[0].id].reshape(2, 2) @ across.T).ravel()

    # Behind the nail the tip's place does not matter, but for where along the wire its outline is read.
    def log_likelihood(tip_mm: float) -> float:
        moved = state.copy()
        moved[TIP] = tip_mm
        return problem.at(moved, REACH_DETECTOR_MM).residuals[0].log_likelihood

    change = np.diff([log_likelihood(tip_mm) for tip_mm in np.arange(104.0, 118.0, 0.05)])
    assert np.sqrt(np.mean(change**2)) < 0.5
    assert np.abs(change).max() < 1.5

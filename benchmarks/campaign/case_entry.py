"""What people enter when they open a case of the campaign, rightly or wrongly."""

from typing import Final

import numpy as np

from benchmarks.campaign.troubles import Error, Troubles
from services.ui_api.handlers.cases import SetupRequest
from simulation.control.models import scenario_body
from simulation.scenario.values import Scenario

# Of the catalogue, those that have the guide's holes.
NAILS: Final = (
    "nail-femur-steel-11",
    "nail-femur-steel-12",
    "nail-femur-ti-10",
    "nail-femur-ti-11-slot",
    "nail-femur-ti-11",
)


def set_up(scenario: Scenario, troubles: Troubles | None) -> SetupRequest:
    """What people enter when they open the case; without troubles what is right."""
    given = scenario_body(scenario).case
    side, nail, extension_mm = given.side.value, given.nail, given.head_extension_mm
    match None if troubles is None else troubles.error:
        case Error.WRONG_SIDE:
            side = "left" if side == "right" else "right"
        case Error.WRONG_NAIL:
            nail = another_nail(scenario)
        case Error.WRONG_EXTENSION:
            assert troubles is not None
            extension_mm += troubles.size if extension_mm < 70.0 else -troubles.size
        case _:
            pass
    return SetupRequest(
        side=side,
        bone=given.bone.value,
        mount=given.mount.value,
        head_extension_mm=extension_mm,
        ring=given.ring,
        guide=given.guide,
        nail=nail,
        hexapod=given.hexapod,
        guide_calibration=None,
        nominal_source_to_detector_mm=given.nominal_source_to_detector_mm,
        nominal_pixel_mm=given.nominal_pixel_mm,
        drill_diameter_mm=scenario.drilling.diameter_mm,
    )


def another_nail(scenario: Scenario) -> str:
    """A nail of the catalogue that has the guide's holes and is not the implanted one."""
    others = [name for name in NAILS if name != scenario.sources.nail.name]
    return others[int(np.random.default_rng([scenario.seed, *b"nail"]).integers(len(others)))]

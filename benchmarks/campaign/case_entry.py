"""What people enter when they open a case of the campaign, rightly or wrongly."""

import json
from typing import Final

import numpy as np
from pydantic import ValidationError

from benchmarks.campaign.troubles import Error, Troubles
from services.ui_api.routes.bodies import CaseBody
from services.ui_api.routes.invalid_request import wrongs_of
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


def set_up(scenario: Scenario, troubles: Troubles | None) -> CaseBody:
    """What people enter when they open the case; without troubles what is right.

    Raises
    ------
    ValidationError
        The gateway refuses what was entered.
    """
    entry = scenario_body(scenario).case.model_dump(mode="json")
    entry["drill_diameter_mm"] = scenario.drilling.diameter_mm
    match None if troubles is None else troubles.error:
        case Error.WRONG_SIDE:
            entry["side"] = "left" if entry["side"] == "right" else "right"
        case Error.WRONG_NAIL:
            entry["nail"] = another_nail(scenario)
        case Error.WRONG_EXTENSION:
            assert troubles is not None
            entry["head_extension_mm"] += troubles.size if entry["head_extension_mm"] < 70.0 else -troubles.size
        case _:
            pass
    return CaseBody.model_validate_json(json.dumps(entry))


def opened_with(scenario: Scenario, troubles: Troubles) -> tuple[CaseBody, str]:
    """With what the case is opened in the end, and what the gateway says of the first entry if it refuses it.

    Nobody gets further with an entry that is refused: it is read again.
    """
    try:
        return set_up(scenario, troubles), ""
    except ValidationError as error:
        (wrong,) = wrongs_of([{**one, "loc": ("body", *one["loc"])} for one in error.errors()])
        return set_up(scenario, None), wrong.message


def another_nail(scenario: Scenario) -> str:
    """A nail of the catalogue that has the guide's holes and is not the implanted one."""
    others = [name for name in NAILS if name != scenario.sources.nail.name]
    return others[int(np.random.default_rng([scenario.seed, *b"nail"]).integers(len(others)))]

"""What tests of live guidance share: the case, a picture of it, and what a full localisation finds there."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from services.registration.core.localise import LocalisationResult, localise
from shared.geometry.calibration import CArmCalibration
from shared.messages.cases import CaseContext
from tests.kept import kept
from tests.unit.services.registration.rendered_case import (
    GUIDE_JSON,
    HEXAPOD_JSON,
    NAIL_JSON,
    RING_JSON,
    Shown,
    rendered,
    rendered_parts,
)


def context(revision: int = 1) -> CaseContext:
    return CaseContext(
        case_id="case-1",
        revision=revision,
        ring_json=RING_JSON,
        guide_json=GUIDE_JSON,
        nail_json=NAIL_JSON,
        hexapod_json=HEXAPOD_JSON,
    )


@cache
def still_picture() -> tuple[NDArray[np.float32], CArmCalibration]:
    return rendered(Shown(), seed=1)


@cache
@kept
def found_in_full() -> LocalisationResult:
    return localise(*still_picture(), rendered_parts())

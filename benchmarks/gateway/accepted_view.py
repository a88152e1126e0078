"""Shots in the virtual room until one is accepted: the C-arm is turned as advised, or a little otherwise."""

import random
from typing import Final

from benchmarks.common.operating_room import OperatingRoom
from distalock.case_client import CaseClient, codes_of, is_accepted, summary_of
from distalock.client.models import LocalisationView
from shared.errors import ReasonCode

_MOST_SHOTS: Final = 10
_ANOTHER_VIEW_DEG: Final = 2.0


def accepted_localisation(room: OperatingRoom, case: CaseClient, source: random.Random) -> LocalisationView:
    """The first that is accepted; raises `RuntimeError` when none of ten is."""
    for _ in range(_MOST_SHOTS):
        seen = case.localisation_of(room.room.take_shot())
        if is_accepted(seen):
            return seen
        turn = seen.c_arm_correction_deg
        if ReasonCode.TILT_TOO_LARGE in codes_of(seen) and turn is not None:
            room.room.turn_c_arm(turn.about_image_x, turn.about_image_y)
        else:
            room.room.turn_c_arm(*(source.uniform(-_ANOTHER_VIEW_DEG, _ANOTHER_VIEW_DEG) for _ in range(2)))
    raise RuntimeError(f"no image of {_MOST_SHOTS} was accepted; the last was {summary_of(seen)}")

"""One procedure of the campaign from its seed: set up, led, judged."""

import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from benchmarks.campaign.c_arm import CArmOperator
from benchmarks.campaign.harm import MotionWatch, harm_of
from benchmarks.campaign.people import People
from benchmarks.campaign.procedure import Procedure
from benchmarks.campaign.room import CampaignRoom, with_troubles
from benchmarks.campaign.rows import CaseRow, Ending
from benchmarks.campaign.system import System
from benchmarks.campaign.troubles import Troubles, troubles_of
from benchmarks.robot.rig import Rig
from simulation.controller.accuracy import seeded
from simulation.scenario.sampling import scenario_of_seed

# Real time, which only a silent controller costs; a busy machine must not look like one.
REPLY_TIMEOUT_S: Final = 0.5
Lead = Callable[[Procedure], str]


def play(seed: int, lead: Lead = Procedure.run) -> CaseRow:
    """Play one procedure; one that ends by an exception is a row, too, so that a long run goes on.

    Parameters
    ----------
    lead
        Leads the procedure; why it did not end with drilled holes, or nothing.
    """
    begun, troubles = time.process_time(), troubles_of(seed)
    try:
        row = _played(seed, troubles, lead)
    except Exception as error:  # noqa: BLE001 - the border of a task: whatever it is, it is a row
        row = replace(_empty_row(seed, troubles), ending=Ending.CRASHED, why=_crash(error))
    return replace(row, took_s=time.process_time() - begun)


def _crash(error: Exception) -> str:
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"crashed: {type(error).__name__} in {Path(place.filename).name}:{place.lineno}: {error}"


def _played(seed: int, troubles: Troubles, lead: Lead) -> CaseRow:
    scenario = with_troubles(scenario_of_seed(seed), troubles)
    rig = Rig(seed, REPLY_TIMEOUT_S, seeded(seed))
    with tempfile.TemporaryDirectory(prefix="distalock-campaign-") as folder:
        system = System(rig, Path(folder))
        room, watch = CampaignRoom(scenario, rig, troubles), MotionWatch(rig)
        people = People(scenario, system, room, watch, troubles)
        procedure, crashed = Procedure(people, CArmOperator(people)), False
        try:
            why = lead(procedure)
        except Exception as error:  # noqa: BLE001 - what harmed until then counts, whatever ended it
            why, crashed = _crash(error), True
        system.close()
    harms = (*watch.harms, *filter(None, (harm_of(hole) for hole in people.holes)))
    return replace(
        _empty_row(seed, troubles),
        ending=_ending(harms, procedure, why, crashed=crashed),
        why=why,
        noticed=tuple(people.noticed),
        harms=harms,
        holes=tuple(people.holes),
        images=room.shots,
        moves=procedure.moves,
        stops=people.stops,
    )


def _empty_row(seed: int, troubles: Troubles) -> CaseRow:
    """What was drawn for a procedure, and nothing of what came of it."""
    return CaseRow(
        seed=seed,
        error=troubles.error.value,
        error_at=troubles.error_at.value,
        image=troubles.image,
        fault="" if troubles.fault is None else troubles.fault.value,
        fault_at=troubles.fault_at.value,
        ending=Ending.DRILLED,
        why="",
        noticed=(),
        harms=(),
        holes=(),
        images=0,
        moves=0,
        stops=0,
        took_s=0.0,
    )


def _ending(harms: tuple[str, ...], procedure: Procedure, why: str, *, crashed: bool) -> Ending:
    if harms:
        return Ending.HARM
    if crashed:
        return Ending.CRASHED
    if procedure.against:
        return Ending.AGAINST_ADVICE
    if not why:
        return Ending.DRILLED
    noticed = procedure.people.noticed
    stopped = noticed and noticed[-1].code in ("fault", "stopped", "failed", "robot_not_ready")
    return Ending.STOPPED if stopped else Ending.REFUSED

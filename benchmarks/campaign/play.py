"""One procedure of the campaign from its seed: set up, led, judged."""

import tempfile
import time
import traceback
from pathlib import Path
from typing import Final

from benchmarks.campaign.harm import MotionWatch, harm_of
from benchmarks.campaign.images import Images
from benchmarks.campaign.people import People
from benchmarks.campaign.procedure import Procedure
from benchmarks.campaign.room import CampaignRoom, with_troubles
from benchmarks.campaign.rows import CaseRow, Ending
from benchmarks.campaign.system import System
from benchmarks.campaign.troubles import troubles_of
from benchmarks.robot.rig import Rig
from simulation.controller.accuracy import seeded
from simulation.scenario.sampling import scenario_of_seed

# Real time, which only a silent controller costs; a busy machine must not look like one.
REPLY_TIMEOUT_S: Final = 0.5


def play(seed: int) -> CaseRow:
    """Play one procedure."""
    begun = time.process_time()
    troubles = troubles_of(seed)
    scenario = with_troubles(scenario_of_seed(seed), troubles)
    rig = Rig(seed, REPLY_TIMEOUT_S, seeded(seed))
    with tempfile.TemporaryDirectory(prefix="distalock-campaign-") as folder:
        system = System(rig, Path(folder))
        room, watch = CampaignRoom(scenario, rig, troubles), MotionWatch(rig)
        people = People(scenario, system, room, watch, troubles)
        procedure = Procedure(people, Images(people))
        why, crashes = _run(procedure)
        system.close()
    harms = (*watch.harms, *crashes, *filter(None, (harm_of(hole) for hole in people.holes)))
    return CaseRow(
        seed=seed,
        error=troubles.error.value,
        error_at=troubles.error_at.value,
        image=troubles.image,
        fault="" if troubles.fault is None else troubles.fault.value,
        fault_at=troubles.fault_at.value,
        ending=_ending(harms, procedure, why),
        why=why,
        noticed=tuple(people.noticed),
        harms=harms,
        holes=tuple(people.holes),
        images=room.shots,
        moves=procedure.moves,
        stops=people.stops,
        took_s=time.process_time() - begun,
    )


def _run(procedure: Procedure) -> tuple[str, tuple[str, ...]]:
    """Why it did not end with drilled holes, and what ended it that nobody foresaw: counted, so that a run goes on."""
    try:
        return procedure.run(), ()
    except Exception as error:  # noqa: BLE001 - whatever it is, it is a row
        place = traceback.extract_tb(error.__traceback__)[-1]
        crash = f"crash: {type(error).__name__} in {Path(place.filename).name}:{place.lineno}: {error}"
        return crash, (crash,)


def _ending(harms: tuple[str, ...], procedure: Procedure, why: str) -> Ending:
    if harms:
        return Ending.HARM
    if procedure.against:
        return Ending.AGAINST_ADVICE
    if not why:
        return Ending.DRILLED
    noticed = procedure.people.noticed
    stopped = noticed and noticed[-1].code in ("fault", "stopped", "failed", "robot_not_ready")
    return Ending.STOPPED if stopped else Ending.REFUSED

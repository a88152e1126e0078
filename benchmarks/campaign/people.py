"""People of the campaign, in simulated time: what happens to them, what they are told, what their hands do."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from benchmarks.campaign.case_entry import set_up
from benchmarks.campaign.harm import UNHEARD, MotionWatch
from benchmarks.campaign.room import CampaignRoom
from benchmarks.campaign.rows import DrilledHole, Moment, Noticed
from benchmarks.campaign.system import WHO, System
from benchmarks.campaign.troubles import Error, Troubles
from services.ui_api.core.case import Case
from services.ui_api.core.event_data import Step
from services.ui_api.handlers.cases import StepRequest
from services.ui_api.handlers.refusals import Refused
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.messages.robot import RobotState
from shared.robot_states import MotionState
from simulation.controller.faults import Fault
from simulation.scenario.sampling import scenario_of_seed
from simulation.scenario.values import Scenario

TICK_S: Final = 0.1
# Longer than registration's `image_delay_s`: nobody presses the pedal within half a second of a motion.
PAUSE_S: Final = 0.8
_TEN_MINUTES_S: Final = 610.0
_AT_REST: Final = (Moment.PREPARE, Moment.IMAGE)
# Codes by which the system names an error, so that people who heed it find it.
_NAMES: Final = {
    Error.WRONG_SIDE: ("laterality_mismatch",),
    Error.WRONG_NAIL: ("nail_model_mismatch", "nail_not_found", "hole_not_visible"),
    Error.WRONG_EXTENSION: ("head_extension", "mount_place"),
    Error.GUIDE_TURNED: ("guide_turned", "nail_model_mismatch", "mount_place"),
    Error.LOOSE_MOUNT: ("images_disagree", "head_extension", "guide_turned", "mount_place"),
}


class GaveUp(Exception):
    """The procedure does not go on; the message says why."""


@dataclass(slots=True)
class People:
    """Those who lead a case: at the console, and with their hands.

    Attributes
    ----------
    moment
        What is to be done next.
    pending
        Which of "error" and "fault" has yet to happen.
    slipped
        Something moved after the newest image.
    mended
        The error has been found and mended, at most once.
    """

    scenario: Scenario
    system: System
    room: CampaignRoom
    watch: MotionWatch
    troubles: Troubles
    moment: Moment = Moment.OPEN
    noticed: list[Noticed] = field(default_factory=list)
    holes: list[DrilledHole] = field(default_factory=list)
    stops: int = 0
    slipped: bool = False
    pending: set[str] = field(default_factory=lambda: {"error", "fault"})
    mended: bool = False

    def last(self) -> str:
        """What was noticed last, as the surgeon reads it."""
        return f"{self.noticed[-1].code}: {self.noticed[-1].sentence}" if self.noticed else "nothing was said"

    def enter(self, moment: Moment) -> None:
        """The next step begins; what goes wrong before it goes wrong now."""
        self.moment = moment
        troubles = self.troubles
        if "fault" in self.pending and troubles.fault is not None and troubles.fault_at is moment is not Moment.MOVE:
            self.pending.discard("fault")
            self._fault(troubles.fault)
        if "error" not in self.pending or troubles.error_at is not moment:
            return
        match troubles.error:
            case Error.LOOSE_MOUNT:
                self.pending.discard("error")
                self._slip()
            case Error.MOVED_LEG:
                self.pending.discard("error")
                self.room.smear_px = troubles.size
            case Error.OLD_IMAGE if moment in (Moment.PLAN, Moment.MOVE):
                self.pending.discard("error")
                self.wait(_TEN_MINUTES_S, 10.0)
            case _:
                return

    def _slip(self) -> None:
        angle = np.random.default_rng([self.scenario.seed, *b"slip"]).uniform(0.0, 2.0 * np.pi)
        size = self.troubles.size
        self.room.slip((size * float(np.cos(angle)), size * float(np.sin(angle)), 0.0))
        self.slipped = True

    def _fault(self, fault: Fault) -> None:
        """Something fails for a while; what the services make of it is seen afterwards."""
        virtual = self.system.rig.virtual
        virtual.inject(fault)
        self.wait(self.troubles.fault_lasts_s)
        if self.moment in _AT_REST and self.robot.state is not MotionState.LOCKED:
            self.stops += 1
            self.note(self.stop_code(), f"the robot is {self.robot.state}: {self.robot.detail}")
        virtual.clear(fault)
        self.wait(PAUSE_S)

    def wait(self, seconds: float, step_s: float = TICK_S) -> None:
        """Let time pass, and everybody do what comes of it."""
        for _ in range(max(1, round(seconds / step_s))):
            self.watch.tick(step_s)
            self.system.settle()

    @contextmanager
    def asked(self) -> Iterator[UnitOfWork]:
        """One request to the gateway; what it makes the services do is done when it has been answered."""
        self.watch.inside = bool(self.system.record.ledger.inside())
        with self.system.record.write() as unit:
            yield unit
        self.system.settle()
        self.watch.inside = bool(self.system.record.ledger.inside())

    def note(self, code: str, sentence: str) -> None:
        """The system said no, or stopped."""
        self.noticed.append(Noticed(self.moment, code, sentence))

    @property
    def case(self) -> Case:
        """The open case."""
        return self.system.open_case

    @property
    def robot(self) -> RobotState:
        """What the robot says of itself."""
        return self.system.rig.state

    def stop_code(self) -> str:
        """Code of the state in which the robot stands."""
        return {MotionState.FAULT: "fault", MotionState.STOPPED: "stopped"}.get(self.robot.state, "failed")

    def disturb_motion(self) -> None:
        """What happens while the robot moves: a stop, or a fault."""
        if self.troubles.error is Error.STOP_PRESSED and "error" in self.pending:
            self.pending.discard("error")
            self.watch.note_stop()
            self.system.stops.stop("the surgeon wants it")
            self.wait(1.0)
        troubles = self.troubles
        if "fault" in self.pending and troubles.fault is not None and troubles.fault_at is Moment.MOVE:
            self.pending.discard("fault")
            if troubles.fault not in UNHEARD:
                self.watch.note_stop_when_at_rest()
            self._fault(troubles.fault)

    def drill_hole(self, hole_id: str, *, allowed: bool) -> None:
        """Drill a hole where the guide is, and keep where its axis was by the truth."""
        truth = next(one for one in self.room.errors() if one.id == hole_id)
        passage = self.room.drill(hole_id)
        self.holes.append(
            DrilledHole(hole_id, truth.entry_offset_mm, truth.angle_deg, passage.passed, allowed, self.slipped)
        )

    def step(self, step: Step, why: str = "", hole_ids: tuple[str, ...] = ()) -> None:
        """Report what hands did."""
        try:
            with self.asked() as unit:
                holes = hole_ids or self.case.hole_ids
                self.system.cases.record_step(unit, self.case.case_id, StepRequest(step, holes, WHO.name, why))
        except Refused as refusal:
            self.note(refusal.code, str(refusal))

    def mend_if_named(self, codes: tuple[str, ...]) -> None:
        """People who heed what is said find the error that it names, mend it, and begin anew."""
        error = self.troubles.error
        if self.mended or not self.troubles.heeds or not set(codes) & set(_NAMES.get(error, ())):
            return
        self.mended = True
        if error is Error.LOOSE_MOUNT:
            self.step(Step.MOUNT_MOVED, "the mount was loose and has been tightened")
        elif error is Error.GUIDE_TURNED:
            self._turn_guide_round()
        else:
            with self.asked() as unit:
                self.system.cases.change_setup(
                    unit, self.case.case_id, set_up(self.scenario, None).request(), WHO.name, "it was wrong"
                )
            self.watch.wrong_side = False

    def _turn_guide_round(self) -> None:
        self.scenario = scenario_of_seed(self.scenario.seed)
        self.room.room.scenario = self.room.scenario = self.scenario
        self.step(Step.MOUNT_MOVED, "the guide was the wrong way round")

"""The actions of one case, each asked for by the client that it is given."""

import time
from dataclasses import dataclass, field
from typing import Final

from benchmarks.faults.acknowledged import AcknowledgingClient
from benchmarks.faults.procedure_site import ProcedureSite
from distalock.case_client import ENDED, CaseClient, is_accepted, summary_of
from distalock.client import Client, RequestRefused
from distalock.client.models import ImageView, LocalisationView, OperationView, PlanView
from distalock.robot_readiness import NotDone, make_robot_ready

_POLL_S: Final = 0.05
# So long that a busy machine is not taken for a lost procedure.
_PATIENCE_S: Final = 240.0


@dataclass(slots=True)
class CaseActions:
    """What is done in the open case, and what came of it. Actions raise `RequestRefused`, `NotDone`, `httpx.HTTPError`.

    Attributes
    ----------
    image_uid
        SOP instance UID of the newest image.
    """

    site: ProcedureSite
    hole_ids: tuple[str, ...] = field(init=False)
    case_id: str = ""
    image_uid: str = ""
    seen: LocalisationView | None = None
    plan: PlanView | None = None
    motion: OperationView | None = None

    def __post_init__(self) -> None:
        self.hole_ids = self.site.room.room.scenario().hole_ids

    def open(self, rest: AcknowledgingClient) -> None:
        """Open a case, or take the one that is open."""
        set_up = self.site.room.room.scenario().set_up
        self.case_id = (open_case_of(rest) or CaseClient.opened(rest, set_up)).id

    def open_and_prepare(self, rest: AcknowledgingClient) -> None:
        """The same, and the robot made ready."""
        self.open(rest)
        make_robot_ready(rest)

    def shoot(self, _: AcknowledgingClient) -> None:
        """Take an image that imaging acknowledges."""
        self.image_uid = self.site.room.room.take_shot()
        self.site.acknowledged.images.append(self.image_uid)

    def localise(self, rest: AcknowledgingClient) -> None:
        """Wait for what the newest image says."""
        self._finished_image(rest)
        self.seen = CaseClient(rest, self.case_id).newest_localisation()
        if not is_accepted(self.seen):
            raise NotDone(summary_of(self.seen))

    def make_plan(self, rest: AcknowledgingClient) -> None:
        """Plan from the newest localisation."""
        assert self.seen is not None
        self.plan = CaseClient(rest, self.case_id).plan(self.seen.number, self.hole_ids)

    def approve(self, rest: AcknowledgingClient) -> None:
        """Consent to the plan."""
        assert self.plan is not None
        CaseClient(rest, self.case_id).approve(self.plan)

    def ask_to_move(self, rest: AcknowledgingClient) -> None:
        """Ask for the approved motion."""
        assert self.plan is not None
        self.motion = CaseClient(rest, self.case_id).begin_motion(self.plan)

    def begin_to_move(self, rest: AcknowledgingClient) -> None:
        """The same, and wait until the hexapod moves, or has been at the target already."""
        self.ask_to_move(rest)
        assert self.motion is not None
        deadline_s = time.monotonic() + _PATIENCE_S
        while not self.site.hexapod().moving:
            operation = rest.read_operation(self.motion.id)
            if operation.status == "succeeded":
                return
            if operation.status in ENDED or time.monotonic() > deadline_s:
                raise NotDone(f"motion {operation.status}: {operation.detail}")

    def finish_to_move(self, rest: AcknowledgingClient) -> None:
        """Follow the motion to its end."""
        assert self.motion is not None
        operation = CaseClient(rest, self.case_id).follow(self.motion)
        if operation.status != "succeeded":
            raise NotDone(f"motion {operation.status}: {operation.detail}")

    def insert_wires(self, rest: AcknowledgingClient) -> None:
        """Wires through the locked guide, and an image of them."""
        self.site.room.room.insert_wires()
        CaseClient(rest, self.case_id).record_step("wires_inserted", self.hole_ids, why="through the locked guide")
        self.shoot(rest)

    def verify(self, rest: AcknowledgingClient) -> None:
        """Wires against axes, in the newest image; in another one when that was skipped, or is of before a fault."""
        try:
            image = self._finished_image(rest)
            CaseClient(rest, self.case_id).verify([image.id])
        except NotDone:
            self.shoot(rest)
            raise
        except RequestRefused as refusal:
            if refusal.problem_code in ("image_stale", "stale"):
                self.shoot(rest)
            raise

    def close(self, rest: AcknowledgingClient) -> None:
        """Pull the wires and close the case, if it is open still."""
        if (case := open_case_of(rest)) is not None:
            self.site.room.room.remove_wires()
            case.record_step("wires_removed", self.hole_ids, why="verified")
            case.record_step("abandoned", why="the benchmark ends here")
        self.case_id = ""

    def _finished_image(self, rest: Client) -> ImageView:
        deadline_s = time.monotonic() + _PATIENCE_S
        case = CaseClient(rest, self.case_id)
        while time.monotonic() < deadline_s:
            image = next((i for i in case.images() if i.sop_instance_uid == self.image_uid), None)
            if image is not None and image.skipped is not None:
                raise NotDone(f"image skipped: {image.skipped.message}")
            if image is not None and image.localisation is not None:
                return image
            time.sleep(_POLL_S)
        raise NotDone(f"image {self.image_uid} is neither localised nor explained after {_PATIENCE_S:g} s")


def open_case_of(rest: Client) -> CaseClient | None:
    """The case that is open, also one whose opening nobody answered."""
    still_open = rest.list_cases(status="open", limit=1, sort="newest").items
    return CaseClient(rest, still_open[0].id) if still_open else None

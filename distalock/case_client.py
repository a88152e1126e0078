"""One case through the gateway's REST interface, as a console sees it."""

import time
from collections.abc import Iterator, Sequence
from typing import Final, Literal

from distalock.client import Client
from distalock.client.models import (
    ApprovalBody,
    CaseBody,
    CasePatch,
    CaseView,
    ImageView,
    LocalisationView,
    MotionBody,
    OperationView,
    PlanBody,
    PlanView,
    StepBody,
    VerificationBody,
    VerificationView,
)
from distalock.rest_client import JsonObject
from distalock.robot_readiness import ENDED as ENDED
from distalock.robot_readiness import make_robot_ready

# No safety limit: a localisation takes a second, and a minute on a busy machine.
_PATIENCE_S: Final = 300.0
_POLL_S: Final = 0.1
_MOST_OF_A_PAGE: Final = 200


class CaseClient:
    """A case."""

    def __init__(self, client: Client, case_id: str) -> None:
        self._client = client
        self.id = case_id

    @staticmethod
    def opened(client: Client, set_up: JsonObject) -> "CaseClient":
        """Open a case with this set-up (the body of ``POST /cases``); raises `RequestRefused`."""
        return CaseClient(client, client.open_case(CaseBody.model_validate(set_up)).id)

    def localisation_of(self, sop_instance_uid: str) -> LocalisationView:
        """Wait for what an image said; raises `TimeoutError`."""
        deadline = time.monotonic() + _PATIENCE_S
        while time.monotonic() < deadline:
            for image in self.images():
                if image.sop_instance_uid == sop_instance_uid and image.localisation is not None:
                    return self._client.read_localisation(self.id, image.localisation)
            time.sleep(_POLL_S)
        raise TimeoutError(f"no localisation of image {sop_instance_uid} after {_PATIENCE_S:.0f} s")

    def images(self) -> Iterator[ImageView]:
        """The images of the case, in the order in which imaging numbered them."""
        return self._client.iterate_images(self.id, limit=_MOST_OF_A_PAGE)

    def newest_localisation(self) -> LocalisationView:
        """What the newest image said."""
        return self._client.read_localisation(self.id, self._client.read_alignment(self.id).localisation)

    def newest_image_id(self) -> str:
        """Hash of the newest image of the case."""
        return self._client.list_images(self.id, limit=1, sort="newest").items[0].id

    def overlay_png(self, image_id: str) -> bytes:
        """What was found, drawn on the image."""
        return self._client.read_png(image_id, view="overlay")

    def plan(self, localisation: int, hole_ids: Sequence[str]) -> PlanView:
        """Ask for the move that makes the axes of these holes coincide; raises `RequestRefused`."""
        self.read()
        return self._client.make_plan(self.id, PlanBody(localisation=localisation, hole_ids=hole_ids))

    def approve(self, plan: PlanView) -> None:
        """Consent to exactly this plan, as the user who is signed in; raises `RequestRefused`."""
        self._client.approve_plan(self.id, plan.number, ApprovalBody(), if_match=f'"{plan.sha256}"')

    def begin_motion(self, plan: PlanView) -> OperationView:
        """Start the approved motion; its operation. Raises `RequestRefused`."""
        self.read()
        return self._client.begin_motion(self.id, MotionBody(plan=plan.number))

    def change_set_up(self, changes: JsonObject) -> CaseView:
        """Change the set-up; the case after it. Raises `RequestRefused`."""
        self.read()
        return self._client.change_case(self.id, CasePatch.model_validate(changes))

    def etag(self) -> str:
        """The case as it is now, for `If-Match`."""
        self.read()
        return str(self._client.etag(f"/api/v1/cases/{self.id}"))

    def read(self) -> CaseView:
        """The case as it is now; each change quotes it, because this client decides by what it has just read."""
        return self._client.read_case(self.id)

    def move(self, plan: PlanView) -> OperationView:
        """Start the approved motion and follow it to its end; raises `RequestRefused`."""
        return self.follow(self.begin_motion(plan))

    def verify(self, image_ids: Sequence[str], of: Literal["wires", "guide"] = "wires") -> VerificationView:
        """Compare wires, or the guide alone, with the nail's holes; raises `RequestRefused`."""
        self.read()
        return self._client.make_verification(self.id, VerificationBody(images=image_ids, of=of))

    def record_step(self, step: str, hole_ids: Sequence[str] = (), why: str = "") -> None:
        """Tell the record what people did with their hands; raises `RequestRefused`."""
        self.read()
        body = {"step": step, "hole_ids": list(hole_ids), "why": why}
        self._client.record_step(self.id, StepBody.model_validate(body))

    def follow(self, begun: OperationView) -> OperationView:
        """Follow an operation to its end; raises `TimeoutError`."""
        operation, deadline = begun, time.monotonic() + _PATIENCE_S
        while operation.status not in ENDED:
            if time.monotonic() > deadline:
                raise TimeoutError(f"operation {operation.id} has not ended after {_PATIENCE_S:.0f} s")
            time.sleep(_POLL_S)
            operation = self._client.read_operation(operation.id)
        return operation

    def make_robot_ready(self) -> None:
        """Bring the robot to where it may move and an image may be taken; raises `NotDone`, `RequestRefused`."""
        make_robot_ready(self._client)

    def abandon(self, why: str) -> None:
        """End the case; raises `RequestRefused`."""
        self.record_step("abandoned", why=why)

    @staticmethod
    def open_cases(client: Client) -> "list[CaseClient]":
        """Cases that are open."""
        return [CaseClient(client, case.id) for case in client.iterate_cases(status="open")]


def is_accepted(seen: LocalisationView) -> bool:
    """Whether a plan may be made from it."""
    return seen.verdict == "accepted"


def codes_of(seen: LocalisationView) -> tuple[str, ...]:
    """Codes of the reasons for a rejection."""
    return tuple(reason.code for reason in seen.reasons)


def summary_of(seen: LocalisationView) -> str:
    """One line for people."""
    if not is_accepted(seen):
        return "rejected: " + "; ".join(f"{r.code}: {r.message}" for r in seen.reasons)
    counts = ", ".join(
        f"{name} {c.balls_found}/{c.balls_expected} balls"
        for name, c in (("ring", seen.camera), ("guide", seen.guide))
        if c is not None
    )
    holes = "; ".join(
        f"{h.id} ± {h.standard_uncertainty.entry_mm:.2f} mm, {h.standard_uncertainty.axis_deg:.2f}°"
        for h in seen.holes or ()
        if h.standard_uncertainty is not None
    )
    return f"accepted: {counts}; {holes}"

"""One case through the gateway's REST interface, as a console sees it."""

import time
from collections.abc import Mapping, Sequence
from typing import Final, Literal, TypeVar

from pydantic import BaseModel, ConfigDict

from distalock.rest_client import JsonObject, RestClient

# No safety limit: a localisation takes a second, and a minute on a busy machine.
_PATIENCE_S: Final = 300.0
_POLL_S: Final = 0.1


class View(BaseModel):
    """What a console reads of an answer; it ignores what it does not show."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class Reason(View):
    """Why something was refused."""

    code: str
    message: str


class Uncertainty(View):
    """Predicted rms errors."""

    entry_mm: float
    axis_deg: float


class SeenHole(View):
    """A nail hole's axis as measured."""

    id: str
    tilt_to_ray_deg: float
    standard_uncertainty: Uncertainty | None


class BallCount(View):
    """How many balls of a part were found."""

    balls_found: int
    balls_expected: int


class Turn(View):
    """How to turn the C-arm, in degrees."""

    about_image_x: float
    about_image_y: float


class Localisation(View):
    """What one image said."""

    number: int
    verdict: Literal["accepted", "rejected"]
    reasons: tuple[Reason, ...]
    camera: BallCount | None
    guide: BallCount | None
    holes: tuple[SeenHole, ...] | None
    c_arm_correction_deg: Turn | None

    @property
    def accepted(self) -> bool:
        """Whether a plan may be made from it."""
        return self.verdict == "accepted"

    @property
    def codes(self) -> tuple[str, ...]:
        """Codes of the reasons for a rejection."""
        return tuple(r.code for r in self.reasons)

    @property
    def summary(self) -> str:
        """One line for people."""
        if not self.accepted:
            return "rejected: " + "; ".join(f"{r.code}: {r.message}" for r in self.reasons)
        counts = ", ".join(
            f"{name} {c.balls_found}/{c.balls_expected} balls"
            for name, c in (("ring", self.camera), ("guide", self.guide))
            if c is not None
        )
        holes = "; ".join(
            f"{h.id} ± {h.standard_uncertainty.entry_mm:.2f} mm, {h.standard_uncertainty.axis_deg:.2f}°"
            for h in self.holes or ()
            if h.standard_uncertainty is not None
        )
        return f"accepted: {counts}; {holes}"


class AxisOffset(View):
    """A guide hole's axis, planned or measured, against the nail hole's."""

    id: str
    entry_offset_mm: float
    exit_offset_mm: float
    angle_deg: float
    chance_to_pass: float


class Verification(View):
    """What is left between the axes."""

    verdict: Literal["accepted", "rejected"]
    reasons: tuple[Reason, ...]
    guide_holes: tuple[AxisOffset, ...]
    wires: tuple[AxisOffset, ...]


class PlannedError(View):
    """What a plan predicts to remain at a hole."""

    id: str
    offset_mm: float
    angle_deg: float
    chance_to_pass: float


class PlanContent(View):
    """The part of a plan that people look at."""

    travel_mm: float
    travel_deg: float
    predicted: tuple[PlannedError, ...]


class Plan(View):
    """A plan and the hash that its approval quotes."""

    number: int
    sha256: str
    plan: PlanContent


class Operation(View):
    """A command to the robot and how it went."""

    id: str
    status: Literal["running", "unknown", "succeeded", "failed", "stopped"]
    detail: str
    deviation_mm: float | None
    deviation_deg: float | None

    @property
    def ended(self) -> bool:
        """Whether nothing more will come of it."""
        return self.status in ("succeeded", "failed", "stopped")


V = TypeVar("V", bound=View)


class CaseClient:
    """A case."""

    def __init__(self, rest: RestClient, case_id: str) -> None:
        self._rest = rest
        self.id = case_id

    @staticmethod
    def opened(rest: RestClient, set_up: JsonObject) -> "CaseClient":
        """Open a case with this set-up (the body of ``POST /cases``); raises `RequestRefused`."""
        return CaseClient(rest, str(rest.post("/api/v1/cases", set_up)["id"]))

    @property
    def _path(self) -> str:
        return f"/api/v1/cases/{self.id}"

    def localisation_of(self, sop_instance_uid: str) -> Localisation:
        """Wait for what an image said; raises `TimeoutError`."""
        deadline = time.monotonic() + _PATIENCE_S
        while time.monotonic() < deadline:
            for image in self.images():
                if image["sop_instance_uid"] == sop_instance_uid and image["localisation"] is not None:
                    return Localisation.model_validate(
                        self._rest.get(f"{self._path}/localisations/{image['localisation']}")
                    )
            time.sleep(_POLL_S)
        raise TimeoutError(f"no localisation of image {sop_instance_uid} after {_PATIENCE_S:.0f} s")

    def images(self) -> list[JsonObject]:
        """The images of the case, in the order in which imaging numbered them."""
        items: list[JsonObject] = []
        cursor = ""
        while True:
            page = self._rest.get(f"{self._path}/images?limit=200{cursor}")
            items += _items(page)
            if page["next_cursor"] is None:
                return items
            cursor = f"&cursor={page['next_cursor']}"

    def newest_localisation(self) -> Localisation:
        """What the newest image said."""
        number = self._rest.get(f"{self._path}/alignment")["localisation"]
        return Localisation.model_validate(self._rest.get(f"{self._path}/localisations/{number}"))

    def newest_image_id(self) -> str:
        """Hash of the newest image of the case."""
        return str(self.images()[-1]["id"])

    def overlay_png(self, image_id: str) -> bytes:
        """What was found, drawn on the image."""
        return self._rest.get_bytes(f"/api/v1/images/{image_id}.png?view=overlay")

    def plan(self, localisation: int, hole_ids: Sequence[str]) -> Plan:
        """Ask for the move that makes the axes of these holes coincide; raises `RequestRefused`."""
        body = {"localisation": localisation, "hole_ids": list(hole_ids)}
        return Plan.model_validate(self._change("plans", body))

    def approve(self, plan: Plan) -> None:
        """Consent to exactly this plan, as the user who is signed in; raises `RequestRefused`."""
        self._rest.post(f"{self._path}/plans/{plan.number}/approval", if_match=f'"{plan.sha256}"')

    def begin_motion(self, plan: Plan) -> JsonObject:
        """Start the approved motion; its operation. Raises `RequestRefused`."""
        return self._change("motions", {"plan": plan.number})

    def change_set_up(self, changes: JsonObject) -> JsonObject:
        """Change the set-up; the case after it. Raises `RequestRefused`."""
        return self._rest.patch(self._path, changes, self.etag())

    def etag(self) -> str:
        """The case as it is now, for `If-Match`."""
        return self._rest.etag(self._path)

    def _change(self, what: str, body: Mapping[str, object]) -> JsonObject:
        """Change the case as it is now: this client decides by what it has just read."""
        return self._rest.post(f"{self._path}/{what}", body, self.etag())

    def move(self, plan: Plan) -> Operation:
        """Start the approved motion and follow it to its end; raises `RequestRefused`."""
        return self.follow(self.begin_motion(plan))

    def verify(self, image_ids: Sequence[str], of: Literal["wires", "guide"] = "wires") -> Verification:
        """Compare wires, or the guide alone, with the nail's holes; raises `RequestRefused`."""
        body = {"images": list(image_ids), "of": of}
        return Verification.model_validate(self._change("verifications", body))

    def record_step(self, step: str, hole_ids: Sequence[str] = (), why: str = "") -> None:
        """Tell the record what people did with their hands; raises `RequestRefused`."""
        self._change("steps", {"step": step, "hole_ids": list(hole_ids), "why": why})

    def follow(self, begun: JsonObject) -> Operation:
        """Follow an operation to its end; raises `TimeoutError`."""
        operation, deadline = Operation.model_validate(begun), time.monotonic() + _PATIENCE_S
        while not operation.ended:
            if time.monotonic() > deadline:
                raise TimeoutError(f"operation {operation.id} has not ended after {_PATIENCE_S:.0f} s")
            time.sleep(_POLL_S)
            operation = Operation.model_validate(self._rest.get(f"/api/v1/operations/{operation.id}"))
        return operation

    def make_robot_ready(self) -> tuple[Operation, Operation]:
        """Acknowledge the stop that every start begins with, then reference; raises `RequestRefused`."""
        acknowledged = self.follow(self._rest.post("/api/v1/robot/acknowledge-stop"))
        return acknowledged, self.follow(self._rest.post("/api/v1/robot/reference"))


def _items(page: JsonObject) -> list[JsonObject]:
    items = page["items"]
    if not isinstance(items, list):
        raise TypeError(f"expected a page with items, got {type(items).__name__}")
    return items

"""What a person's hands do in the virtual operating room: foot pedal, C-arm, wires, drill. Only for tests and demos."""

from dataclasses import dataclass

from distalock.rest_client import JsonObject, RestClient


@dataclass(frozen=True, slots=True)
class TrueError:
    """A guide hole's axis against the nail hole's, by the virtual room's own truth."""

    hole_id: str
    entry_offset_mm: float
    exit_offset_mm: float
    angle_deg: float


@dataclass(frozen=True, slots=True)
class DrillResult:
    """Where a drill went."""

    hole_id: str
    passed: bool
    entry_offset_mm: float
    exit_offset_mm: float
    struck: str | None


@dataclass(frozen=True, slots=True)
class Scenario:
    """What people in the room know of it.

    Attributes
    ----------
    set_up
        Body of ``POST /cases``.
    """

    set_up: JsonObject
    hole_ids: tuple[str, ...]
    description: str


class RoomClient:
    """The virtual operating room's control API."""

    def __init__(self, client: RestClient) -> None:
        self._client = client

    def scenario(self) -> Scenario:
        """The scenario that the room plays."""
        content = self._client.get("/scenario")
        set_up, hole_ids = content["case"], content["hole_ids"]
        if not isinstance(set_up, dict) or not isinstance(hole_ids, list):
            raise TypeError("/scenario: expected a case and a list of hole_ids")
        nail = set_up["nail"] if isinstance(set_up["nail"], str) else "a nail of its own"
        description = f"{set_up['side']} {set_up['bone']}, {nail}, mounted on {set_up['mount']}, seed {content['seed']}"
        return Scenario(set_up, tuple(map(str, hole_ids)), description)

    def take_shot(self) -> str:
        """Step on the foot pedal; the SOP instance UID of the image that was sent."""
        return str(self._client.post("/shots")["sop_instance_uid"])

    def turn_c_arm(self, about_image_x_deg: float, about_image_y_deg: float) -> None:
        """Turn source and detector together, as the alignment advice says."""
        body = {"about_image_x_deg": about_image_x_deg, "about_image_y_deg": about_image_y_deg}
        self._client.post("/c-arm/turn", body)

    def insert_wires(self) -> None:
        """A K-wire through every guide hole."""
        self._client.post("/wires")

    def remove_wires(self) -> None:
        """Pull the K-wires out."""
        self._client.delete("/wires")

    def drill(self, hole_id: str) -> DrillResult:
        """Drill through the guide hole of this id."""
        d = self._client.post("/drills", {"hole_id": hole_id})
        struck = d.get("struck")
        return DrillResult(
            str(d["hole_id"]),
            d["passed"] is True,
            _number(d["entry_offset_mm"]),
            _number(d["exit_offset_mm"]),
            None if struck is None else str(struck),
        )

    def true_errors(self) -> tuple[TrueError, ...]:
        """Each guide hole's axis against the nail's hole of the same id."""
        rows = self._client.get("/truth")["guide_errors"]
        if not isinstance(rows, list):
            raise TypeError(f"/truth: expected a list of guide_errors, got {type(rows).__name__}")
        return tuple(
            TrueError(
                str(r["hole_id"]), _number(r["entry_offset_mm"]), _number(r["exit_offset_mm"]), _number(r["angle_deg"])
            )
            for r in rows
        )


def _number(value: object) -> float:
    if not isinstance(value, int | float):
        raise TypeError(f"expected a number, got {value!r}")
    return float(value)

"""The virtual hexapod's own truth about itself."""

from pydantic import BaseModel, ConfigDict


class Hexapod(BaseModel):
    """The virtual hexapod as it is, on the monotonic clock of this machine."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    clock_s: float
    pose: tuple[float, float, float, float, float, float]
    moving: bool
    at_rest_since_s: float | None
    locked_since_s: float | None
    was_unheld: bool

    @property
    def safe_since_s(self) -> float | None:
        """Since when it has been at rest and locked; None while it is not."""
        if self.at_rest_since_s is None or self.locked_since_s is None:
            return None
        return max(self.at_rest_since_s, self.locked_since_s)

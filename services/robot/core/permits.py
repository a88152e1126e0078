"""What the robot knows of a permit: what it allows, whether the gateway signed it, and which were used. Pure."""

from dataclasses import dataclass
from enum import StrEnum

from services.robot.core.tuning import PERMITS


class Motion(StrEnum):
    """What a permit can allow."""

    MOVE = "move"
    REFERENCE = "reference"


class SignatureFailure(StrEnum):
    """Why what came with a command is not the gateway's word: found before a word of it is read."""

    MISSING = "missing"
    ALTERED = "altered"
    OTHER_KEY = "other_key"
    FORGED = "forged"
    UNREADABLE = "unreadable"


@dataclass(frozen=True, slots=True)
class Permit:
    """The gateway's word that one motion may begin once.

    Attributes
    ----------
    plan_sha256, hole_ids
        Of a move: its plan and the holes that it is for. None and empty for a reference.
    case_id, case_revision
        The open case; None when none was open.
    robot_boot_epoch, after_state_sequence
        Run of the robot service, and the newest of its states that the gateway had seen.
    approver
        Who approved the plan, or asked for the reference.
    hexapod_sha256
        The hexapod that it is for; None in permits of older gateways.
    nothing_inside
        Whether, by the case's record, no wire, drill or screw is in the guide or the bone.
    nonce
        Unlike that of any other permit.
    """

    motion: Motion
    plan_sha256: str | None
    hole_ids: tuple[str, ...]
    case_id: str | None
    case_revision: int
    robot_boot_epoch: str
    after_state_sequence: int
    approver: str
    nothing_inside: bool
    nonce: str
    hexapod_sha256: str | None = None


@dataclass(frozen=True, slots=True)
class AskedMotion:
    """The motion that a command asks for.

    Attributes
    ----------
    hole_ids
        Of the plan as registration published it; None when the robot does not know the plan.
    """

    motion: Motion
    plan_sha256: str | None = None
    hole_ids: tuple[str, ...] | None = ()


@dataclass(frozen=True, slots=True)
class UsedPermits:
    """Permits that were taken, as long as they could come again.

    Attributes
    ----------
    taken
        Nonce of each, and when the state that it quotes was published.
    """

    taken: tuple[tuple[str, float], ...] = ()

    def holds(self, nonce: str) -> bool:
        """Whether a permit was taken."""
        return any(known == nonce for known, _ in self.taken)

    def with_taken(self, nonce: str, quoted_published_s: float, now_s: float) -> "UsedPermits":
        """Note a permit; those that have expired are refused by their age and need no place here."""
        alive = tuple(entry for entry in self.taken if not has_expired(entry[1], now_s))
        return UsedPermits((*alive, (nonce, quoted_published_s)))


@dataclass(frozen=True, slots=True)
class PermitContext:
    """What the robot itself knows when a permit is presented.

    Attributes
    ----------
    asked
        What the command asks for.
    hexapod_sha256
        The hexapod that this service was started with.
    now_s
        Own monotonic clock.
    case
        Id and revision of the open case; None before the gateway has published it.
    inside
        What is in the guide or the bone, as the gateway has published it: "wire in distal", ...
    newest_state
        Number of the newest state that the robot published; None before the first.
    first_since_stop
        Number of the first state that was published after the last stop.
    quoted_published_s
        When the robot published the state that the permit quotes; None when it has no record of it.
    """

    asked: AskedMotion
    boot_epoch: str
    hexapod_sha256: str
    now_s: float
    case: tuple[str | None, int] | None
    inside: tuple[str, ...]
    newest_state: int | None
    first_since_stop: int
    quoted_published_s: float | None
    used: UsedPermits


def has_expired(quoted_published_s: float, now_s: float) -> bool:
    """Whether a permit that quotes a state published then can be used no more."""
    return now_s - quoted_published_s > PERMITS.lifetime_s


@dataclass(frozen=True, slots=True)
class PermitRecord:
    """What is published of permits.

    Attributes
    ----------
    taken_sha256
        Hash of the text of the permit that was taken last.
    refused, refusal
        How many were refused, and the code of the last refusal.
    """

    taken_sha256: str | None = None
    refused: int = 0
    refusal: str = ""

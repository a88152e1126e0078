"""The gateway's permit for one motion of the robot, and how it travels.

What is signed is the very text that travels (`SignedPermit.permit_json`): nothing is encoded again before it is
verified. A permit says in its schema name which version of the format it is; the permit key signs nothing else.
"""

from typing import Annotated, Literal

from pydantic import Field

from shared.messages.base import Identifier, Message, MessageModel, Sha256

# A permit has some 360 characters; names and holes may be long.
MOST_PERMIT_CHARACTERS = 4096


class Permit(Message):
    """One motion may begin once."""

    schema_name: Literal["distalock/permit/1"] = Field("distalock/permit/1", alias="schema")
    motion: Literal["move", "reference"]
    plan_sha256: Sha256 | None = Field(description="Plan of a move; null for a reference.")
    hole_ids: tuple[str, ...] = Field(description="Holes of the plan; empty for a reference.")
    case_id: Identifier | None = Field(description="The open case; null when none is open.")
    case_revision: int = Field(ge=0)
    robot_boot_epoch: Identifier
    after_state_sequence: int = Field(
        ge=0, description="Newest robot state that the gateway had seen: the permit's age counts from its publication."
    )
    approver: str = Field(
        min_length=1, max_length=128, description="Who approved the plan, or asked for the reference."
    )
    authenticated_by: Literal["password", "passkey", "provider", "simulation_token"] | None = Field(
        None, description="How the approver showed for this motion who he is; null in permits of older versions."
    )
    hexapod_sha256: Sha256 | None = Field(
        None, description="The hexapod of robot and case, by the part's hash; null in permits of older versions."
    )
    nothing_inside: bool = Field(
        description="By the case's record no wire, drill or screw is in the guide or the bone."
    )
    nonce: Identifier = Field(description="Unlike that of any other permit.")


class SignedPermit(MessageModel):
    """A permit with its signature. The hash tells an altered text from a forged signature."""

    permit_json: str = Field(max_length=MOST_PERMIT_CHARACTERS)
    permit_sha256: Sha256 = Field(description="Hash of `permit_json`; records and states name the permit by it.")
    key_sha256: Sha256 = Field(description="Hash of the public key (its 32 bytes) under which it verifies.")
    signature: Annotated[str, Field(pattern=r"^[0-9a-f]{128}$", description="Ed25519 (RFC 8032) over `permit_json`.")]

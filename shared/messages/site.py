"""What a room lets the hospital's control desk see: published by its exporter at the site's router, and nowhere else.

It names no patient and holds no image. The other way there is no message: a control desk commands nothing.
"""

from typing import Literal

from pydantic import Field

from shared.messages.base import Finite, Identifier, Message, MessageModel
from shared.messages.presence import ServiceName
from shared.robot_states import MotionState, StopLatch


class ServiceSummary(MessageModel):
    """One service of the room, as its status and its liveliness token show it."""

    service: ServiceName
    alive: bool = Field(description="Its liveliness token is there.")
    condition: Literal["starting", "ready", "degraded", "stopping", "unknown"] = "unknown"
    version: str = ""
    detail: str = ""


class RobotSummary(MessageModel):
    """The robot, as its newest state has it."""

    state: MotionState
    stop: StopLatch
    locked: bool
    age_s: Finite = Field(ge=0.0, description="Of that state, by the exporter's clock.")
    detail: str = ""


class RoomSummary(Message):
    """One operating room at a glance: at every change, and every second."""

    schema_name: Literal["distalock/room-summary/1"] = Field("distalock/room-summary/1", alias="schema")
    room: Identifier
    exporter_epoch: Identifier = Field(description="A run of the exporter: sequence numbers begin anew with each.")
    sequence: int = Field(ge=0)
    link_up: bool = Field(description="The exporter reaches the room's own router.")
    services: tuple[ServiceSummary, ...] = Field(max_length=16)
    robot: RobotSummary | None
    case_id: Identifier | None = Field(description="Of the open case; it names no patient.")
    messages_denied: int = Field(0, ge=0, description="By the room's router since its start.")
    links_refused: int = Field(0, ge=0)

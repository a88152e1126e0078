"""Who is there and how it fares: heartbeats and service status."""

from typing import Literal

from pydantic import Field

from shared.messages.base import Identifier, Message, UnixNanoseconds

ServiceName = Literal["imaging", "registration", "robot", "ui_api"]


class Heartbeat(Message):
    """Sent regularly by a service; a gap means that its interpreter hangs, whatever its liveliness token says."""

    schema_name: Literal["distalock/heartbeat/1"] = Field("distalock/heartbeat/1", alias="schema")
    service: ServiceName
    boot_epoch: Identifier
    sequence: int = Field(ge=0)


class ServiceStatus(Message):
    """Last known condition of a service, for health pages and consoles."""

    schema_name: Literal["distalock/status/1"] = Field("distalock/status/1", alias="schema")
    service: ServiceName
    boot_epoch: Identifier
    version: str
    condition: Literal["starting", "ready", "degraded", "stopping"]
    detail: str = ""
    impaired: tuple[str, ...] = Field((), description="Causes by name, such as `disk`; the sentences are in `detail`.")
    sent_at_ns: UnixNanoseconds

"""What the router has refused: published by the router itself, in numbers that only grow, so that one may be lost."""

from enum import StrEnum
from typing import Literal

from pydantic import Field

from shared.messages.base import Identifier, Message, MessageModel, UnixNanoseconds

# Chosen: more than one service with a stolen key tries in a second, and a message of 16 kB.
MOST_REFUSALS = 64
# Chosen: longer than any key of the table.
LONGEST_TEXT = 200


class RefusalCode(StrEnum):
    """What was refused."""

    MESSAGE_DENIED = "message_denied"
    LINK_REFUSED = "link_refused"
    UNKNOWN_NAME = "unknown_name"


class BusRefusal(MessageModel):
    """What one sender tried in one way on one key, and how often."""

    code: RefusalCode
    service: str = Field(max_length=LONGEST_TEXT, description="Common name of its certificate; empty without a link.")
    what: str = Field(max_length=LONGEST_TEXT, description="Kind of message, or what was wrong with the certificate.")
    key: str = Field(max_length=LONGEST_TEXT, description="Key expression of a denied message; its beginning, if long.")
    times: int = Field(ge=1, description="Since it was first seen; counted anew when others pushed it out.")
    last_at_ns: UnixNanoseconds


class BusRefusals(Message):
    """At every change, at most once a second, and every few seconds for who joins late."""

    schema_name: Literal["distalock/bus-refusals/1"] = Field("distalock/bus-refusals/1", alias="schema")
    router_epoch: Identifier = Field(description="A run of the router: the numbers begin anew with each.")
    messages_denied: int = Field(ge=0)
    links_refused: int = Field(ge=0)
    unknown_names: int = Field(ge=0, description="Links of certificates of the authority whose names have no rules.")
    gaps: int = Field(ge=0, description="How often refusals came faster than they could be counted.")
    newest: tuple[BusRefusal, ...] = Field(max_length=MOST_REFUSALS, description="The newest of all, oldest first.")

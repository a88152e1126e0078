"""What a bad line does to bytes: drops, doubles and changes them at random, echoes, cuts answers short, delays them."""

import random
from collections.abc import Set as AbstractSet

from simulation.controller.faults import Fault
from simulation.controller.gcs_protocol import LINE_END, SingleByte

SPOILT_SHARE = 0.01
SLOW_REPLY_S = 0.4
_LOST_AT_THE_END = 3
_NO_REPLY = b"\xff\xfe?\x80\n"


def carried(content: bytes, faults: AbstractSet[Fault], noise: random.Random) -> bytes:
    """Bytes as they arrive at the other end of the line."""
    for fault in (Fault.DROPPED_BYTES, Fault.DUPLICATED_BYTES, Fault.WRONG_BYTES):
        if fault in faults:
            content = b"".join(_spoilt(byte, fault, noise) for byte in content)
    return content


def _spoilt(byte: int, fault: Fault, noise: random.Random) -> bytes:
    if noise.random() >= SPOILT_SHARE:
        return bytes([byte])
    match fault:
        case Fault.DROPPED_BYTES:
            return b""
        case Fault.DUPLICATED_BYTES:
            return bytes([byte, byte])
        case _:
            return bytes([noise.randrange(256)])


def answered(command: str | SingleByte, reply: bytes, faults: AbstractSet[Fault]) -> bytes:
    """What the controller sends back for a command whose right answer is `reply` (which may be empty)."""
    if reply and Fault.GARBAGE_REPLY in faults:
        reply = _NO_REPLY
    if Fault.PARTIAL_REPLY in faults:
        reply = reply[:-_LOST_AT_THE_END]
    if Fault.ECHO in faults and isinstance(command, str):
        reply = command.encode("latin-1") + LINE_END + reply
    return reply


def reply_delay_s(faults: AbstractSet[Fault]) -> float:
    """How late answers come."""
    return SLOW_REPLY_S if Fault.SLOW_REPLY in faults else 0.0

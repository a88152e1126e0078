"""Attacks with the gateway's stolen key: commands that are malformed, forged, altered, late or repeated."""

import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from shared.bus.zenoh_bus import ZenohBus
from shared.errors import NoReply
from shared.messages.base import decode, encode
from shared.messages.robot import CommandEnvelope, CommandReply, PlainCommand, RobotState, Verb
from tests.attacks.attack import Attack, Record
from tests.attacks.site import Site, wait_until

NO_REPLY: Final = "no reply"


@dataclass(frozen=True, slots=True)
class Thief:
    """A session with the gateway's stolen key, and what it has heard of the robot."""

    bus: ZenohBus
    site: Site
    state: RobotState

    def envelope(self, **changes: object) -> CommandEnvelope:
        """An envelope as the gateway would make it now, but for the changes."""
        good: dict[str, object] = {
            "command_id": uuid.uuid4().hex,
            "client": f"thief-{uuid.uuid4().hex[:8]}",
            "client_sequence": 1,
            "robot_boot_epoch": self.state.boot_epoch,
            "after_state_sequence": self.site.robot_state(self.bus).sequence,
            "time_to_live_s": 2.0,
            "issued_at_ns": time.time_ns(),
        }
        return CommandEnvelope.model_validate(good | changes)

    def ask(self, verb: Verb, payload: bytes) -> str:
        """Send a command; the code of its refusal, or what else came of it."""
        try:
            reply = decode(CommandReply, self.bus.query(self.site.keys.robot_command(verb), payload, 5.0).payload)
        except NoReply:
            return NO_REPLY
        return reply.code if reply.verdict == "refused" else "accepted"

    def acknowledge(self, **changes: object) -> str:
        """Ask for what is allowed to the gateway without a permit, with a changed envelope."""
        command = PlainCommand(verb="acknowledge_stop", envelope=self.envelope(**changes))
        return self.ask("acknowledge_stop", encode(command))


def as_thief(attack: Callable[[Thief], str]) -> Callable[[Site], str]:
    """An attack with the gateway's key."""

    def run(site: Site) -> str:
        with site.open_as("ui_api") as bus:
            return attack(Thief(bus, site, site.robot_state(bus)))

    return run


def _sent(verb: Verb, payload: bytes) -> Callable[[Site], str]:
    return as_thief(lambda thief: thief.ask(verb, payload))


def _late(thief: Thief) -> str:
    """What was right a moment ago."""
    envelope = thief.envelope(time_to_live_s=0.5)
    time.sleep(1.0)
    return thief.ask("reset", encode(PlainCommand(verb="reset", envelope=envelope)))


def _reordered(thief: Thief) -> str:
    client = f"thief-{uuid.uuid4().hex[:8]}"
    thief.acknowledge(client=client, client_sequence=7)
    return thief.acknowledge(client=client, client_sequence=6)


def _reused_id(thief: Thief) -> str:
    """One id for two commands."""
    command_id = uuid.uuid4().hex
    thief.acknowledge(command_id=command_id)
    reset = PlainCommand(verb="reset", envelope=thief.envelope(command_id=command_id))
    return thief.ask("reset", encode(reset))


def _repeated(thief: Thief) -> str:
    """The same bytes again and again: only the first is looked at, the others get its answer."""
    payload = encode(PlainCommand(verb="acknowledge_stop", envelope=thief.envelope()))
    answers = {thief.ask("acknowledge_stop", payload) for _ in range(20)}
    return f"20 times {answers.pop()}" if len(answers) == 1 else f"{len(answers)} answers"


def _other_key(thief: Thief) -> str:
    """A reset on the key of acknowledgements."""
    return thief.ask("acknowledge_stop", encode(PlainCommand(verb="reset", envelope=thief.envelope())))


def _robot(text: str) -> Record:
    return Record("robot", text)


_KEY: Final = "the gateway's key of the bus"
_LARGE_BYTES: Final = 10 * 2**20
_DEEP: Final = 100_000
_REFUSED: Final = "message_invalid"

ATTACKS: Final = (
    Attack(
        "malformed command", _KEY, "a move that is no JSON", _REFUSED, _robot(_REFUSED), _sent("move", b"\xff\x00{")
    ),
    Attack("large command", _KEY, "a move of 10 MiB", _REFUSED, _robot(_REFUSED), _sent("move", b"x" * _LARGE_BYTES)),
    Attack(
        "deep command",
        _KEY,
        f"a move of {_DEEP} nested lists",
        _REFUSED,
        _robot(_REFUSED),
        _sent("move", b"[" * _DEEP + b"]" * _DEEP),
    ),
    Attack(
        "command on another key",
        _KEY,
        "a reset as an acknowledgement",
        _REFUSED,
        _robot(_REFUSED),
        as_thief(_other_key),
    ),
    Attack(
        "forged epoch",
        _KEY,
        "a command for a boot of the robot that never was",
        "wrong_boot_epoch",
        _robot("wrong_boot_epoch"),
        as_thief(lambda thief: thief.acknowledge(robot_boot_epoch="0" * 16)),
    ),
    Attack(
        "forged state number",
        _KEY,
        "a command that quotes a state from the future",
        "state_not_published",
        _robot("state_not_published"),
        as_thief(lambda thief: thief.acknowledge(after_state_sequence=10**9)),
    ),
    Attack(
        "late command",
        _KEY,
        "a command held back for 1 s, valid for 0.5 s",
        "command_expired",
        _robot("command_expired"),
        as_thief(_late),
    ),
    Attack(
        "reordered command",
        _KEY,
        "command 6 after command 7",
        "command_out_of_order",
        _robot("command_out_of_order"),
        as_thief(_reordered),
    ),
    Attack(
        "altered repeat",
        _KEY,
        "another command under an id that was used",
        "command_id_reused",
        _robot("command_id_reused"),
        as_thief(_reused_id),
    ),
    Attack(
        "replay", _KEY, "one command 20 times", "20 times nothing_to_do", _robot("nothing_to_do"), as_thief(_repeated)
    ),
)


def _replayed_after_restart(thief: Thief) -> str:
    """What was right before the robot service was started anew, byte for byte."""
    payload = encode(PlainCommand(verb="acknowledge_stop", envelope=thief.envelope()))
    before = thief.state.boot_epoch
    thief.site.fleet.restart("robot")
    wait_until(lambda: thief.site.robot()["boot_epoch"] != before, "the robot service after its restart")
    return thief.ask("acknowledge_stop", payload)


AFTER_RESTART: Final = Attack(
    "replay across restart",
    _KEY,
    "a command that was right, after the robot service was started anew",
    "wrong_boot_epoch",
    _robot("wrong_boot_epoch"),
    as_thief(_replayed_after_restart),
)

"""Commands that a bad network delivers late, twice, shuffled, to another boot; writes robot-delivery.md under docs.

A hostile post office stands between gateway and robot service: every command is copied, held back, shuffled and sent
again long after. Each may take effect at most once, and none after its time to live.
"""

import random
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from benchmarks.common.places import PAGES
from benchmarks.robot.plans import random_target
from benchmarks.robot.rig import Rig, SentCommand
from shared.messages.robot import CommandReply
from shared.robot_states import MotionState

COMMANDS = 10_000
COMMANDS_PER_RIG = 100
FIRST_SEED = 500
TARGET_SIZE = 0.15
LATEST_DELIVERY_S = 4.0
# Nothing is silent here: a busy machine must not look like it.
REPLY_TIMEOUT_S = 1.0
REPORT = PAGES / "robot-delivery.md"


@dataclass(frozen=True, slots=True)
class _Letter:
    """A copy of a command on its way."""

    due_s: float
    written_s: float
    number: int
    command: SentCommand
    time_to_live_s: float


@dataclass(slots=True)
class DeliveryResult:
    """What came of commands and their copies.

    Attributes
    ----------
    moves
        How many commands led to a motion.
    late, doubled
        Motions that began later than the time to live, or for a second time.
    refusals
        By code.
    """

    commands: int = 0
    copies: int = 0
    moves: int = 0
    late: int = 0
    doubled: int = 0
    refusals: Counter[str] = field(default_factory=Counter)


class _PostOffice:
    """Delivers copies of commands when they are due, and counts what they do."""

    def __init__(self, rig: Rig, source: random.Random, result: DeliveryResult) -> None:
        self._rig, self._source, self._result = rig, source, result
        self._letters: list[_Letter] = []
        self._moved: set[int] = set()

    def post(self, command: SentCommand, number: int, time_to_live_s: float) -> None:
        """One to four copies, each with its own delay; some at once."""
        for _ in range(self._source.randint(1, 4)):
            delay_s = self._source.choice((0.0, 0.0, self._source.uniform(0.0, LATEST_DELIVERY_S)))
            due_s = self._rig.now_s + delay_s
            self._letters.append(_Letter(due_s, self._rig.now_s, number, command, time_to_live_s))
        self._result.commands += 1

    def deliver_due(self) -> None:
        """In an order of its own."""
        due = [letter for letter in self._letters if letter.due_s <= self._rig.now_s]
        self._letters = [letter for letter in self._letters if letter.due_s > self._rig.now_s]
        self._source.shuffle(due)
        for letter in due:
            self._deliver(letter)

    def _deliver(self, letter: _Letter) -> None:
        was_moving = self._rig.status.state is MotionState.MOVING
        reply = self._rig.ask(letter.command)
        self._result.copies += 1
        if reply.verdict == "refused":
            self._result.refusals[reply.code] += 1
        if not was_moving and self._rig.status.state is MotionState.MOVING:
            self._note_motion(letter, reply)

    def _note_motion(self, letter: _Letter, reply: CommandReply) -> None:
        self._result.moves += 1
        self._result.doubled += letter.number in self._moved or reply.verdict != "accepted"
        # The state that it quotes was published up to one tick before it was written.
        self._result.late += self._rig.now_s - letter.written_s > letter.time_to_live_s
        self._moved.add(letter.number)


def run_rig(seed: int, commands: int = COMMANDS_PER_RIG) -> DeliveryResult:
    """Send commands to one robot through the post office."""
    rig, source, result = Rig(seed, REPLY_TIMEOUT_S), random.Random(seed), DeliveryResult()
    rig.make_ready()
    post_office = _PostOffice(rig, source, result)
    for number in range(commands):
        envelope = rig.envelope()
        time_to_live_s = source.choice((0.2, 1.0, 2.0))
        changes: dict[str, object] = {"time_to_live_s": time_to_live_s}
        if source.random() < 0.1:
            changes["robot_boot_epoch"] = "earlier-boot"
        plan = rig.publish_plan(random_target(source, TARGET_SIZE))
        command = rig.move(plan, envelope=envelope.model_copy(update=changes))
        post_office.post(command, number, time_to_live_s)
        post_office.deliver_due()
        for _ in range(source.randint(1, 5)):
            rig.tick()
            post_office.deliver_due()
        if rig.status.state in (MotionState.STOPPED, MotionState.FAULT):
            raise AssertionError(f"seed {seed}: the robot has stopped: {rig.status.detail}")
    result.doubled += len(rig.sent_moves) - result.moves if len(rig.sent_moves) > result.moves else 0
    rig.leave()
    return result


def total_of(results: Iterable[DeliveryResult]) -> DeliveryResult:
    """Sum."""
    total = DeliveryResult()
    for r in results:
        total.commands += r.commands
        total.copies += r.copies
        total.moves += r.moves
        total.late += r.late
        total.doubled += r.doubled
        total.refusals += r.refusals
    return total


def main() -> int:
    """Send all, write the report; 0 when nothing came late or twice."""
    total = total_of(run_rig(FIRST_SEED + i) for i in range(COMMANDS // COMMANDS_PER_RIG))
    report = _report(total)
    print(report)
    REPORT.write_text(report)
    return 0 if total.late == total.doubled == 0 else 1


def _report(total: DeliveryResult) -> str:
    refusals = ", ".join(f"{count} `{code}`" for code, count in total.refusals.most_common())
    return (
        "# Commands that come late, twice or out of order\n\n"
        "Made by `distalock bench robot_delivery`: approved moves on the whole robot service; every command goes out "
        "in "
        "one to four copies,\nat once or up to 4 s later, in shuffled order; one in ten for another boot of the "
        "service.\n\n"
        "| what | number | limit |\n|---|---|---|\n"
        f"| commands | {total.commands} | |\n"
        f"| copies delivered | {total.copies} | |\n"
        f"| commands that led to a motion | {total.moves} | |\n"
        f"| of these later than the time to live | {total.late} | 0 |\n"
        f"| of these for a second time | {total.doubled} | 0 |\n"
        f"| refusals | {refusals} | |\n"
    )


if __name__ == "__main__":
    sys.exit(main())

"""The whole table, in the order in which the attacks are tried, and its page."""

from pathlib import Path
from typing import Final

from tests.attacks import commands, imaging_port, links, listeners, pages, parts, people, permits, roles, streams, web
from tests.attacks.attack import Attack

# Tried while the approved plan could move the robot at once.
BEFORE_THE_MOVE: Final[tuple[Attack, ...]] = (
    *links.ATTACKS,
    *listeners.ATTACKS,
    *roles.ATTACKS,
    *commands.ATTACKS,
    *permits.ATTACKS,
    *streams.ATTACKS,
    *pages.ATTACKS,
    *web.ATTACKS,
    *people.ATTACKS,
    *parts.ATTACKS,
)
# These bring images, stops and a restart, after which no plan of before moves anything.
AFTER_THE_MOVE: Final[tuple[Attack, ...]] = (
    *permits.AFTER_THE_MOVE,
    *imaging_port.ATTACKS,
    streams.FORGED_EPOCH,
    web.STOP_FLOOD,
    commands.AFTER_RESTART,
)
ATTACKS: Final = (*BEFORE_THE_MOVE, *AFTER_THE_MOVE)
PAGE: Final = Path(__file__).parents[2] / "docs" / "attacks.md"
_BEGIN, _END = "<!-- attacks: begin -->", "<!-- attacks: end -->"


def page_with_table(page: str) -> str:
    """The page with the table between its markers."""
    before, rest = page.split(_BEGIN)
    _, after = rest.split(_END)
    return f"{before}{_BEGIN}\n{table()}\n{_END}{after}"


def table() -> str:
    """The attacks as a table in Markdown."""
    rows = [_row(number, attack) for number, attack in enumerate(ATTACKS, 1)]
    head = "| | attack | the attacker has | and tries | refused with | on record |\n|---|---|---|---|---|---|"
    return "\n".join([head, *rows])


def _row(number: int, attack: Attack) -> str:
    cells = (str(number), attack.name, attack.attacker, attack.attempt, f"`{attack.refusal}`", _on_record(attack))
    return f"| {' | '.join(cells)} |"


def _on_record(attack: Attack) -> str:
    return "" if attack.record is None else f"{attack.record.log}: `{attack.record.text}`"

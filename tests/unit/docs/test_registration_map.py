"""The map in `docs/registration.md` names twelve steps, each with a file and a function that exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
STEPS = re.findall(r"^\| (\d+) \| [^|]+ \| `([^`]+\.py)` `(\w+)` \|", (ROOT / "docs/registration.md").read_text(), re.M)


def test_there_are_twelve_steps() -> None:
    assert [int(number) for number, _, _ in STEPS] == list(range(1, 13))


def test_every_step_names_a_function_that_is_there() -> None:
    missing = [(file, name) for _, file, name in STEPS if f"\ndef {name}(" not in (ROOT / file).read_text()]
    assert missing == []

"""What an attack is: what the attacker has, what is tried, how it must be refused, and where that must be on record."""

from collections.abc import Callable
from dataclasses import dataclass

from tests.attacks.site import Site


@dataclass(frozen=True, slots=True)
class Record:
    """Where a refusal must be found.

    Attributes
    ----------
    log
        Name of the process whose log has it.
    text
        What its line contains, as a regular expression.
    """

    log: str
    text: str


@dataclass(frozen=True, slots=True)
class Attack:
    """One row of the table.

    Attributes
    ----------
    attacker
        What the attacker has, beyond access to the machine's ports.
    attempt
        What is tried.
    refusal
        What `run` must observe: the code of the refusal, or the behaviour where no code can be given.
    record
        None where nothing was refused, or where it was at a router of the attacker's own.
    run
        Tries it; returns what was observed.
    """

    name: str
    attacker: str
    attempt: str
    refusal: str
    record: Record | None
    run: Callable[[Site], str]

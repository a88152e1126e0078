"""What the pages of the risk file share."""

from collections.abc import Iterable, Iterator
from typing import Final

NOT_A_DEVICE: Final = "Research software, not a medical device."


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    """Lines of a Markdown table."""
    names = tuple(head)
    yield f"| {' | '.join(names)} |"
    yield "|" + "---|" * len(names)
    yield from (f"| {' | '.join(row)} |" for row in rows)

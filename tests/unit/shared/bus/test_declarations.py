"""How items of a channel are handed on."""

import weakref
from collections.abc import Iterator

from shared.bus.declarations import pump


class Item:
    """Something that holds a place in shared memory."""


class Channel:
    """Yields two items; says whether anybody still held the first when the second was asked for."""

    held: bool | None = None

    def __iter__(self) -> Iterator[Item]:
        first = weakref.ref(item := Item())
        yield_of = [item]
        del item
        yield yield_of.pop()
        self.held = first() is not None
        yield Item()

    def undeclare(self) -> None:
        """As any."""


def test_no_item_is_held_while_the_next_one_is_awaited() -> None:
    channel, handled = Channel(), []
    pump(channel, lambda item: handled.append(type(item)), "key").join()
    assert channel.held is False
    assert handled == [Item, Item]

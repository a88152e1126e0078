"""What the bus promises about liveliness and about the link."""

from tests.contract.bus.rooms import Collector, Room, eventually


def test_tokens_that_are_there_appear_and_vanish(room: Room) -> None:
    seen: Collector[tuple[str, bool]] = Collector()
    with room.open() as watcher:
        with room.open() as early:
            early.presence().declare_alive("alive-a/early")
            watcher.presence().watch_alive("alive-a/*", lambda key, alive: seen.add((key, alive)))
            seen.wait_for(("alive-a/early", True))
            with room.open() as late:
                token = late.presence().declare_alive("alive-a/late")
                seen.wait_for(("alive-a/late", True))
                token.close()
                seen.wait_for(("alive-a/late", False))
        seen.wait_for(("alive-a/early", False))


def test_link_loss_takes_all_tokens_and_its_return_brings_them_back(own_room: Room) -> None:
    seen: Collector[tuple[str, bool]] = Collector()
    with own_room.open() as watcher, own_room.open() as other:
        other.presence().declare_alive("alive-b/other")
        watcher.presence().watch_alive("alive-b/*", lambda key, alive: seen.add((key, alive)))
        seen.wait_for(("alive-b/other", True))
        assert watcher.presence().link_up()
        own_room.cut()
        seen.wait_for_last(("alive-b/other", False))
        eventually(lambda: not watcher.presence().link_up())
        own_room.restore()
        seen.wait_for_last(("alive-b/other", True))
        assert watcher.presence().link_up()


def test_own_token_vanishes_with_the_link(own_room: Room) -> None:
    seen: Collector[tuple[str, bool]] = Collector()
    with own_room.open() as bus:
        bus.presence().declare_alive("alive-c/self")
        bus.presence().watch_alive("alive-c/self", lambda key, alive: seen.add((key, alive)))
        seen.wait_for(("alive-c/self", True))
        own_room.cut()
        seen.wait_for(("alive-c/self", False))
        own_room.restore()
        seen.wait_for_last(("alive-c/self", True))

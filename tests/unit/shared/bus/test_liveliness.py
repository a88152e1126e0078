"""Tokens count only while the link is there."""

from shared.bus.liveliness import AliveView


def test_link_loss_takes_tokens_away_and_its_return_brings_those_back_that_still_are() -> None:
    told: list[tuple[str, bool]] = []
    view = AliveView(lambda key, alive: told.append((key, alive)))
    view.on_token("a", alive=True)
    view.on_token("b", alive=True)
    view.on_link(up=False)
    view.on_token("b", alive=False)
    view.on_link(up=True)
    view.on_token("b", alive=True)
    assert told == [("a", True), ("b", True), ("a", False), ("b", False), ("a", True), ("b", True)]


def test_only_changes_are_told() -> None:
    told: list[tuple[str, bool]] = []
    view = AliveView(lambda key, alive: told.append((key, alive)))
    for alive in (False, True, True, False, False):
        view.on_token("a", alive=alive)
    view.on_link(up=False)
    view.on_token("a", alive=True)
    assert told == [("a", True), ("a", False)]


def test_a_handler_that_fails_for_one_token_is_told_of_the_others() -> None:
    told: list[str] = []

    def handle(key: str, alive: bool) -> None:  # noqa: FBT001 - the signature is the bus's
        told.append(key)
        if alive is False and key == "a":
            raise ZeroDivisionError

    view = AliveView(handle)
    view.on_token("a", alive=True)
    view.on_token("b", alive=True)
    view.on_link(up=False)
    assert told == ["a", "b", "a", "b"]

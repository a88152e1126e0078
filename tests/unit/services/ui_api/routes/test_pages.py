"""Pages of a list, also of one that loses its older entries between two of them."""

from services.ui_api.routes.pages import page


def test_pages_follow_one_another() -> None:
    first = page(range(5), None, 2, str)
    second = page(range(5), first.next_cursor, 2, str)
    last = page(range(5), second.next_cursor, 2, str)
    assert (first.items, second.items, last.items, last.next_cursor) == (["0", "1"], ["2", "3"], ["4"], None)


def test_a_list_that_loses_older_entries_leaves_none_out_of_its_next_page() -> None:
    first = page(range(10), None, 4, str)
    after_more_and_loss = page(range(3, 12), first.next_cursor, 4, str, lost=3)
    assert after_more_and_loss.items == ["4", "5", "6", "7"]
    everything_shown_is_gone = page(range(6, 12), first.next_cursor, 4, str, lost=6)
    assert everything_shown_is_gone.items == ["6", "7", "8", "9"]

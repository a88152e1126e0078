"""Who reads nothing is cut off; who reads slowly is not."""

import asyncio

import pytest

from services.ui_api.outlet import READS_WITHIN_S, Outlet


class Line(asyncio.Transport):
    """A connection of which so much waits to go out."""

    waiting_bytes = 0
    aborted = False

    def get_write_buffer_size(self) -> int:
        return self.waiting_bytes

    def abort(self) -> None:
        self.aborted = True


CASES = [((9, 9, 9), True), ((9, 8, 8), False), ((9, 0, 9), False), ((0, 0, 0), False)]


@pytest.mark.parametrize(("waiting", "ends"), CASES)
def test_who_reads_nothing_for_long_is_cut_off(waiting: tuple[int, ...], ends: object) -> None:
    line = Line()
    outlet = Outlet(line)
    for look, bytes_ in enumerate(waiting):
        line.waiting_bytes = bytes_
        outlet.end_if_stuck(look * 0.6 * READS_WITHIN_S)
    assert line.aborted is ends

"""The virtual controller knows since when it has been at rest and locked, however late it is asked."""

from shared.parts.hexapod_file import default_hexapod
from simulation.controller.gcs_protocol import SingleByte
from simulation.controller.virtual_controller import VirtualController


class Clock:
    """Time that goes on when a test says so."""

    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def moving_controller(clock: Clock) -> VirtualController:
    controller = VirtualController(default_hexapod(), clock)
    for line in ("SVO X 1", "BRA X 0", "FRF X", "MOV X 3"):
        controller.receive(line)
    return controller


def test_a_fresh_controller_is_at_rest_and_locked() -> None:
    clock = Clock()
    controller = VirtualController(default_hexapod(), clock)
    clock.now_s = 105.0
    assert (controller.snapshot().at_rest_since_s, controller.snapshot().locked_since_s) == (100.0, 100.0)


def test_what_moves_is_neither_at_rest_nor_locked() -> None:
    clock = Clock()
    controller = moving_controller(clock)
    clock.now_s = 100.1
    seen = controller.snapshot()
    assert seen.moving
    assert (seen.at_rest_since_s, seen.locked_since_s) == (None, None)


def test_the_end_of_a_move_is_known_though_nobody_looked() -> None:
    looked_often, looked_late = Clock(), Clock()
    often, late = moving_controller(looked_often), moving_controller(looked_late)
    while often.snapshot().moving:
        looked_often.now_s += 0.001
    looked_late.now_s = 200.0
    ended_s = late.snapshot().at_rest_since_s
    assert ended_s is not None
    assert abs(ended_s - looked_often.now_s) < 0.002


def test_a_stop_ends_a_move_when_it_comes() -> None:
    clock = Clock()
    controller = moving_controller(clock)
    clock.now_s = 100.2
    controller.receive(SingleByte.STOP_ALL)
    clock.now_s = 101.0
    controller.receive("BRA X 1")
    clock.now_s = 102.0
    controller.receive("SVO X 0")
    clock.now_s = 110.0
    seen = controller.snapshot()
    assert (seen.at_rest_since_s, seen.locked_since_s) == (100.2, 102.0)

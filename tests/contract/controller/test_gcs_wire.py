"""What any GCS 2.0 client may expect of the virtual controller, letter by letter, over TCP and a pseudo-terminal."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest
import serial

from shared.parts.hexapod_file import default_hexapod
from simulation.controller.faults import Fault
from simulation.controller.hexapod_model import Encoders
from simulation.controller.moves import RAMP_S
from simulation.controller.servers import tcp_server, terminal_server
from simulation.controller.virtual_controller import VirtualController
from tests.contract.controller.wire import PATIENCE_S, Bench, Clock, Line


def _bench(transport: str, stack: ExitStack, encoders: Encoders = Encoders.ABSOLUTE) -> Bench:
    clock = Clock()
    controller = VirtualController(default_hexapod(), clock, encoders=encoders)
    if transport == "tcp":
        url = f"socket://127.0.0.1:{stack.enter_context(tcp_server(controller))}"
    else:
        url = stack.enter_context(terminal_server(controller))

    def connect() -> Line:
        return Line(stack.enter_context(serial.serial_for_url(url, timeout=PATIENCE_S)))

    return Bench(controller, clock, connect)


@pytest.fixture(params=["tcp", "pty"])
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    with ExitStack() as stack:
        yield _bench(request.param, stack)


def test_it_says_that_it_is_simulated(bench: Bench) -> None:
    maker, model, *_ = bench.line.ask("*IDN?").split(",")
    assert "simulated" in maker
    assert model.strip() == "virtual hexapod"


def test_bare_values(bench: Bench) -> None:
    assert bench.line.ask("CSV?") == "2.0\n"
    assert bench.line.ask("SAI?") == "X \nY \nZ \nU \nV \nW\n"
    assert bench.line.ask("ERR?") == "0\n"
    assert bench.line.ask("VLS?") == "2.000000\n"
    assert bench.line.ask("VMO? X 1") == "1\n"
    assert bench.line.ask("VMO? Z 99") == "0\n"
    assert bench.line.ask("\x05") == "0\n"
    assert bench.line.ask("\x07") == "\xb1\n"


def test_axis_queries_answer_all_axes_or_the_named(bench: Bench) -> None:
    zeros = " \n".join(f"{axis}=0.000000" for axis in "XYZUVW") + "\n"
    assert bench.line.ask("POS?") == zeros
    assert bench.line.ask("MOV?") == zeros
    assert bench.line.ask("POS? W X") == "W=0.000000 \nX=0.000000\n"
    assert bench.line.ask("SVO?") == " \n".join(f"{axis}=0" for axis in "XYZUVW") + "\n"
    assert bench.line.ask("BRA? Z") == "Z=1\n"
    assert bench.line.ask("FRF? Z") == "Z=0\n"
    assert bench.line.ask("ONT? X") == "X=0\n"
    assert bench.line.ask("SPI?").count("=") == 3
    lowest, highest = bench.line.ask("TMN? Z"), bench.line.ask("TMX? Z")
    assert float(lowest.removeprefix("Z=")) == pytest.approx(-8.0, abs=0.5)
    assert float(highest.removeprefix("Z=")) == pytest.approx(8.0, abs=0.5)


def test_help_lists_every_command_and_nothing_else_is_one(bench: Bench) -> None:
    first, *lines, last = bench.line.ask("HLP?").splitlines()
    assert first == "The following commands are valid: "
    assert last == "end of help"
    listed = {line.split()[0] for line in lines}
    queries = "*IDN? SVO? FRF? MOV? POS? ONT? VMO? VLS? SPI? BRA? TMN? TMX? ERR? SAI? CSV? HLP? VER?"
    assert listed == set(f"{queries} SVO FRF MOV VLS SPI BRA HLT STP #5 #7 #24".split())
    assert bench.line.tell("JOG X 1") == 2
    assert len(bench.line.ask("VER?").splitlines()) >= 2


def test_a_move_from_unlocking_to_locking(bench: Bench) -> None:
    bench.unlock()
    assert bench.line.tell("VLS 1.0") == 0
    assert bench.line.tell("MOV X 1.5 W -2") == 0
    assert bench.line.ask("\x05") == "3F\n"
    assert bench.line.ask("ONT? X") == "X=0\n"
    bench.clock.pass_by(1.0)
    assert 0.0 < float(bench.line.ask("POS? X").removeprefix("X=")) < 1.5
    bench.clock.pass_by(10.0)
    assert bench.line.ask("\x05") == "0\n"
    assert bench.line.ask("ONT? X") == "X=1\n"
    assert bench.line.ask("POS? X W") == "X=1.500000 \nW=-2.000000\n"
    assert bench.line.tell("BRA X 1") == 0
    assert bench.line.tell("SVO X 0") == 0
    assert bench.controller.snapshot().held
    assert not bench.controller.snapshot().was_unheld


@pytest.mark.parametrize(
    ("command", "error"),
    [
        ("MOV", 1),
        ("MOV X", 1),
        ("MOV X one", 1),
        ("MOV X nan", 1),
        ("POS? X\x01", 1),
        ("NOP", 2),
        ("MOV X 1", 5),
        ("VLS 2.5", 8),
        ("VLS 0", 8),
        ("MOV Q 1", 15),
        ("SVO X 2", 17),
        ("HLT", 10),
        ("STP", 10),
        ("\x18", 10),
    ],
)
def test_errors_are_silent_until_asked_for_and_then_forgotten(bench: Bench, command: str, error: int) -> None:
    assert bench.line.tell(command) == error
    assert bench.line.ask("ERR?") == "0\n"


def test_unreachable_target_is_refused_and_nothing_moves(bench: Bench) -> None:
    bench.unlock()
    assert bench.line.tell("MOV Z 20") == 7
    assert bench.line.ask("\x05") == "0\n"
    assert bench.line.ask("MOV? Z") == "Z=0.000000\n"


def test_smooth_and_abrupt_stops(bench: Bench) -> None:
    bench.unlock()
    for stop, moves_on in (("HLT", True), ("STP", False), ("\x18", False)):
        assert bench.line.tell("MOV X 5" if moves_on else "MOV X -5") == 0
        bench.clock.pass_by(0.5)
        before = bench.line.ask("POS? X")
        assert bench.line.tell(stop) == 10
        bench.clock.pass_by(RAMP_S + 0.001)
        assert bench.line.ask("\x05") == "0\n"
        assert (bench.line.ask("POS? X") != before) is moves_on
        at_rest = bench.line.ask("POS? X")
        bench.clock.pass_by(10.0)
        assert bench.line.ask("POS? X") == at_rest


def test_stop_byte_is_obeyed_inside_a_line(bench: Bench) -> None:
    bench.unlock()
    assert bench.line.tell("MOV X 5") == 0
    bench.clock.pass_by(0.5)
    bench.line.send("MOV Y\x18 1")
    bench.line.send("\x05")
    assert bench.line.read() == "0\n"


def test_rotation_order_and_pivot_by_hand(bench: Bench) -> None:
    # Pivot (10, 0, 0) in the top. Rx(2 deg)·Ry(0)·Rz(3 deg): W turns first about the top's own axis in this product,
    # so the top's x axis points to (cos 3, cos 2 sin 3, sin 2 sin 3) and its origin lies 10 mm behind the pivot.
    bench.unlock()
    assert bench.line.tell("SPI R 10 S 0 T 0") == 0
    assert bench.line.tell("MOV U 2 W 3") == 0
    bench.clock.pass_by(60.0)
    top = bench.controller.snapshot().base_from_top
    x_axis = [0.9986295348, 0.0523040746, 0.0018264985]
    height = bench.controller.hexapod.zero_height_mm
    assert top.rotation[:, 0] == pytest.approx(x_axis, abs=1e-9)
    origin = [10.0 - 10.0 * x_axis[0], -10.0 * x_axis[1], height - 10.0 * x_axis[2]]
    assert top.translation_mm == pytest.approx(origin, abs=1e-8)
    assert bench.line.tell("SPI R 0") == 9


@pytest.mark.parametrize("transport", ["tcp", "pty"])
def test_incremental_encoders_move_home_and_are_not_ready_meanwhile(transport: str) -> None:
    with ExitStack() as stack:
        bench = _bench(transport, stack, Encoders.INCREMENTAL)
        bench.unlock()
        assert bench.line.tell("MOV X 2") == 0
        bench.clock.pass_by(10.0)
        assert bench.line.tell("FRF") == 0
        assert bench.line.ask("\x07") == "\xb0\n"
        assert bench.line.ask("FRF? X") == "X=0\n"
        bench.clock.pass_by(10.0)
        assert bench.line.ask("\x07") == "\xb1\n"
        assert bench.line.ask("FRF? X") == "X=1\n"
        assert bench.line.ask("POS? X") == "X=0.000000\n"


def test_silence_hears_nothing_and_says_nothing_but_moves_on(bench: Bench) -> None:
    bench.unlock()
    assert bench.line.tell("MOV X 4") == 0
    bench.clock.pass_by(0.5)
    bench.controller.inject(Fault.SILENCE)
    bench.line.send("POS? X\n\x18")
    assert bench.line.silent()
    bench.clock.pass_by(10.0)
    bench.controller.clear(Fault.SILENCE)
    assert bench.line.ask("POS? X") == "X=4.000000\n"


def test_garbage_replies_are_no_replies(bench: Bench) -> None:
    bench.controller.inject(Fault.GARBAGE_REPLY)
    reply = bench.line.ask("POS? X")
    assert not reply.isascii()
    bench.controller.clear(Fault.GARBAGE_REPLY)
    assert bench.line.ask("POS? X") == "X=0.000000\n"


def test_emergency_stop_shows_on_the_wire(bench: Bench) -> None:
    bench.unlock()
    assert bench.line.tell("MOV X 4") == 0
    bench.clock.pass_by(0.5)
    bench.controller.inject(Fault.EMERGENCY_STOP)
    assert bench.line.ask("\x05") == "0\n"
    assert bench.line.ask("SVO? X") == "X=0\n"
    assert bench.line.ask("BRA? X") == "X=1\n"
    assert [bench.line.ask("ERR?") for _ in range(2)] == ["500\n", "500\n"]
    assert bench.line.tell("SVO X 1") == 500
    bench.controller.clear(Fault.EMERGENCY_STOP)
    assert [bench.line.ask("ERR?") for _ in range(2)] == ["501\n", "0\n"]
    assert bench.line.tell("SVO X 1") == 0


def test_client_may_go_and_come_back(bench: Bench) -> None:
    bench.unlock()
    bench.line._port.close()
    bench.line = bench.connect()
    assert bench.line.ask("SVO? X") == "X=1\n"

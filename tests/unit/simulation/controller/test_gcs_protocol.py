"""Bytes to commands, and values to replies."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulation.controller.gcs_protocol import (
    LONGEST_LINE,
    Assembler,
    GcsRefusal,
    Line,
    SingleByte,
    axes_of,
    axis_values,
    flags_reply,
    lines_reply,
    motion_status_reply,
    parse_line,
    ready_reply,
    values_reply,
)

AXES = ("X", "Y", "Z")


def test_lines_and_single_bytes_come_out_in_order() -> None:
    assembler = Assembler()
    assert assembler.feed(b"POS?\nMO") == ["POS?"]
    assert assembler.feed(b"V X 1\r\n\x05") == ["MOV X 1", SingleByte.MOTION_STATUS]


def test_stop_byte_inside_an_unfinished_line_is_seen_at_once() -> None:
    assembler = Assembler()
    assert assembler.feed(b"MOV X\x18") == [SingleByte.STOP_ALL]
    assert assembler.feed(b" 1\n") == ["MOV X 1"]


@given(st.lists(st.sampled_from(["POS?", "MOV X 1", "ERR?", SingleByte.READY]), max_size=20), st.data())
def test_how_bytes_are_cut_does_not_matter(commands: list[str | SingleByte], data: st.DataObject) -> None:
    wire = b"".join(bytes([c]) if isinstance(c, SingleByte) else c.encode() + b"\n" for c in commands)
    cut = data.draw(st.integers(0, len(wire)))
    assembler = Assembler()
    assert assembler.feed(wire[:cut]) + assembler.feed(wire[cut:]) == commands


@given(st.binary(max_size=200))
def test_any_bytes_are_a_command_or_a_syntax_error(received: bytes) -> None:
    for command in Assembler().feed(received + b"\n"):
        if not isinstance(command, SingleByte) and not (command.isascii() and command.isprintable()):
            with pytest.raises(GcsRefusal, match="SYNTAX"):
                parse_line(command)


def test_overlong_lines_are_refused_and_cost_no_memory() -> None:
    assembler = Assembler()
    (line,) = assembler.feed(b"M" * 1_000_000 + b"\n")
    assert isinstance(line, str)
    assert len(line) == LONGEST_LINE + 1
    with pytest.raises(GcsRefusal, match="LINE_TOO_LONG"):
        parse_line(line)


def test_lines_are_split_into_words() -> None:
    assert parse_line("mov  X 1.5 ") == Line("MOV", ("X", "1.5"))
    assert parse_line("   ") is None


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ([], "SYNTAX"),
        (["X"], "SYNTAX"),
        (["X", "1", "Y"], "SYNTAX"),
        (["X", "one"], "SYNTAX"),
        (["X", "nan"], "SYNTAX"),
        (["X", "1_0"], "SYNTAX"),
        (["X", "1", "X", "2"], "SYNTAX"),
        (["Q", "1"], "UNKNOWN_AXIS"),
    ],
)
def test_wrong_axis_values_are_refused(words: list[str], error: str) -> None:
    with pytest.raises(GcsRefusal, match=error):
        axis_values(words, AXES)


def test_axis_values_and_axes() -> None:
    assert axis_values(["Z", "-1.5e-1", "X", "+.5"], AXES) == {"Z": -0.15, "X": 0.5}
    assert axes_of([], AXES) == AXES
    assert axes_of(["Z", "X"], AXES) == ("Z", "X")


def test_replies_letter_by_letter() -> None:
    assert lines_reply(["only"]) == b"only\n"
    assert values_reply({"X": 1.0, "Y": -0.0000004}) == b"X=1.000000 \nY=-0.000000\n"
    assert flags_reply(("X", "Y"), 1) == b"X=1 \nY=1\n"
    assert motion_status_reply(0x3F) == b"3F\n"
    assert motion_status_reply(0) == b"0\n"
    assert ready_reply(ready=True) == b"\xb1\n"
    assert ready_reply(ready=False) == b"\xb0\n"

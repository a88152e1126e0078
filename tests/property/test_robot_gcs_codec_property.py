"""GCS text: every value comes back as it was sent, and noise is refused, never misread."""

import string

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.robot.devices.controller import ReplyGarbled
from services.robot.devices.gcs import codec
from shared.errors import DeviceError
from shared.geometry.hexapod import AXES, PlatformPose

VALUES = st.floats(-100.0, 100.0)
POSES = st.builds(PlatformPose, *[VALUES] * 6)
NOISE = st.lists(st.text(max_size=20), max_size=8)
# The machine may be busy: how long an example takes is not what is tested.
UNHURRIED = settings(deadline=None)


@UNHURRIED
@given(POSES)
def test_a_pose_sent_comes_back_within_a_nanometre(pose: PlatformPose) -> None:
    words = codec.command("MOV", codec.pose_values(pose)).decode().split()[1:]
    lines = [f"{axis}={value}" for axis, value in zip(words[::2], words[1::2], strict=True)]
    assert codec.parse_pose(lines, "MOV?").as_array() == pytest.approx(pose.as_array(), abs=6e-7)


@UNHURRIED
@given(POSES, st.permutations(AXES))
def test_the_order_of_the_lines_does_not_matter(pose: PlatformPose, order: list[str]) -> None:
    values = codec.pose_values(pose)
    lines = [f"{axis}={values[axis]!r}" for axis in order]
    assert codec.parse_pose(lines, "POS?") == pose


@UNHURRIED
@given(NOISE)
def test_noise_is_refused_or_is_exactly_an_answer(lines: list[str]) -> None:
    for parse in (
        lambda: codec.parse_pose(lines, "POS?"),
        lambda: codec.parse_switches(lines, AXES, "SVO?"),
        lambda: codec.parse_number(lines, "VLS?"),
        lambda: codec.parse_integer(lines, "ERR?"),
        lambda: codec.parse_motion_status(lines),
        lambda: codec.parse_text(lines, "*IDN?"),
    ):
        try:
            parse()
        except ReplyGarbled as error:
            assert "is not an answer to it" in str(error)  # noqa: PT017 - any other exception fails the test by itself


@UNHURRIED
@given(POSES, st.integers(0, 5), st.sampled_from(string.ascii_letters + "_ =;\x00\xff"))
def test_a_letter_in_a_number_is_refused(pose: PlatformPose, which: int, noise: str) -> None:
    lines = [f"{axis}={value:.6f}" for axis, value in codec.pose_values(pose).items()]
    lines[which] = lines[which][:-2] + (noise if noise not in "eE" else "x") + lines[which][-1:]
    with pytest.raises(ReplyGarbled):
        codec.parse_pose(lines, "POS?")


@UNHURRIED
@given(POSES, st.integers(0, 5))
def test_a_missing_a_repeated_and_a_foreign_axis_are_refused(pose: PlatformPose, which: int) -> None:
    lines = [f"{axis}={value!r}" for axis, value in codec.pose_values(pose).items()]
    for wrong in (lines[:which] + lines[which + 1 :], [*lines, lines[which]], [*lines, "Q=1"]):
        with pytest.raises(ReplyGarbled):
            codec.parse_pose(wrong, "POS?")


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1_0", "١", "1e999", "", "0x10", "1,5", "\x1f1.5", "1.5\x85"])
def test_numbers_that_python_would_take_and_a_controller_never_sends_are_refused(text: str) -> None:
    with pytest.raises(ReplyGarbled):
        codec.parse_number([text], "VLS?")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_numbers_that_are_not_finite_are_never_sent(value: float) -> None:
    with pytest.raises(DeviceError, match="cannot be sent to the controller"):
        codec.command("MOV", {"X": value})


@UNHURRIED
@given(st.integers(0, 0xFFFF))
def test_the_motion_status_is_hexadecimal(mask: int) -> None:
    assert codec.parse_motion_status([f"{mask:X}"]) is (mask != 0)
    assert codec.parse_motion_status([f"0x{mask:x}"]) is (mask != 0)


@pytest.mark.parametrize("value", ["2", "-1", "0.5"])
def test_switches_are_zero_or_one(value: str) -> None:
    with pytest.raises(ReplyGarbled):
        codec.parse_switches([f"{axis}={value}" for axis in AXES], AXES, "SVO?")

"""Bad usage of the command: one line on stderr, exit code 2; and output that nobody reads."""

import os
import re
import subprocess
import sys

import pytest

from distalock.__main__ import COMMANDS, main
from distalock.arguments import EXIT_UNREAD

ROBOT_COMMANDS = ("workspace", "calibration-poses", "calibrate-guide")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "required: COMMAND"),
        (["dance"], "invalid choice: 'dance'"),
        (["up"], "one of the arguments --simulate --controller is required"),
        (["up", "--simulate", "--controller", "/dev/null"], "not allowed with argument"),
        (["up", "--simulate", "--rest-port", "70000"], "'70000' is not a port number from 1 to 65535"),
        (["demo", "--seed", "one"], "--seed: 'one': Input should be a valid integer"),
        (["demo", "--scenario", "none.json"], "file none.json does not exist"),
        (["demo", "--seed", "-1"], "--seed: '-1': Input should be greater than or equal to 0"),
        (["demo", "--seed", "²"], "--seed: '²': Input should be a valid integer"),
        (["demo", "--scenario", "."], ". is a folder; name a file in it"),
        (["demo", "--overlay", "/none/x.png"], "/none/x.png: cannot be written: there is no folder /none"),
        (["robot", "workspace", "--out", "."], ".: cannot be written: it is a folder; name a file in it"),
        (["robot", "calibration-poses", "--count", "-1"], "'-1' is not a number of images from 5 to 50"),
        (["align", "", "--ring", "r", "--guide", "g", "--nail", "n"], "'' names no file; give the name of one"),
        (["locate", "i", "--ring", "", "--guide", "g", "--nail", "n"], "'' names no file; give the name of one"),
        (["align", "x" * 300, "--ring", "r", "--guide", "g", "--nail", "n"], "cannot be looked at: File name too long"),
        (["qa", "", "--ring", "r"], "'' names no file; give the name of one"),
        (["bench", "speed"], "there is no benchmark 'speed'"),
        (["locate", "image.png"], "required: --ring, --guide, --nail"),
    ],
)
def test_bad_usage_is_one_line(words: list[str], expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert expected in printed.err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--controller", ""], "'' is no address of a controller: "),
        (["--controller", "nonsense://x"], "protocol 'nonsense' not known; give one such as /dev/ttyUSB0"),
        (["--controller", "/dev/none", "--seed", "1"], "--seed and --scenario belong to --simulate"),
        (["--simulate", "--rest-port", "7447"], "ports 7447, 7447, 11112, 50000, 8900 are not 5 different ones"),
    ],
)
def test_an_installation_that_cannot_work_is_not_begun(
    words: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["up", *words])
    except SystemExit as ended:
        code = int(str(ended.code))
    printed = capsys.readouterr()
    assert (code, printed.out, printed.err.count("\n")) == (2, "", 1)
    assert expected in printed.err


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert re.fullmatch(r"distalock \d+\.\d+\.\d+(, revision [0-9a-f]+\+?)?\n", capsys.readouterr().out)


@pytest.mark.parametrize("command", [[one.name] for one in COMMANDS] + [["robot", name] for name in ROBOT_COMMANDS])
def test_arguments_are_declared_without_heavy_imports(command: list[str]) -> None:
    """Bad arguments are answered at once: none of the numerical libraries is imported for that."""
    script = (
        "import sys; from distalock.__main__ import main\n"
        "try: main(sys.argv[1:])\nexcept SystemExit as ended: assert ended.code == 2, ended.code\n"
        "found = {'numpy', 'cv2', 'scipy', 'numba'} & set(sys.modules); assert not found, found"
    )
    words = [sys.executable, "-c", script, *command, "--nope"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (0, ""), ended.stderr


def test_a_reader_that_left_is_no_traceback() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    words = [sys.executable, "-m", "distalock", "robot", "calibration-poses"]
    ended = subprocess.run(words, stdout=writing, stderr=subprocess.PIPE, check=False, text=True)
    os.close(writing)
    assert ended.returncode == EXIT_UNREAD
    assert ended.stderr == ""


@pytest.mark.parametrize("command", [[one.name] for one in COMMANDS] + [["robot", name] for name in ROBOT_COMMANDS])
def test_every_command_explains_itself(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*command, "--help"])
    assert ended.value.code == 0
    assert "usage: distalock" in capsys.readouterr().out

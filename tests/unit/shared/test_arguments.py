"""Arguments of every program: bad usage is one line and exit code 2."""

import pytest

from shared.arguments import EXIT_BAD_INPUT, OneLineParser


def test_bad_usage_is_one_line_with_the_way_to_help(capsys: pytest.CaptureFixture[str]) -> None:
    parser = OneLineParser(prog="a-program")
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(["--none"])
    assert ended.value.code == EXIT_BAD_INPUT == 2
    assert capsys.readouterr() == ("", "a-program: unrecognized arguments: --none (see a-program --help)\n")

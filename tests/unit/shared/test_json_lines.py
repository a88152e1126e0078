"""Lines of a file of JSON lines end with a line feed alone."""

import json

import pytest

from shared.json_lines import json_lines


def test_every_line_is_one_json_text() -> None:
    objects = [{"why": end} for end in ("\n", "\r\n", "\x0b", "\x0c", "\x1c", "\x85", "\u2028", "\u2029")]
    text = "".join(json.dumps(one, ensure_ascii=False) + "\n" for one in objects)
    assert [json.loads(line) for line in json_lines(text)] == objects


@pytest.mark.parametrize(
    ("text", "lines"), [("", []), ("a", ["a"]), ("a\n", ["a"]), ("a\n\nb\n", ["a", "", "b"]), ("\n", [""])]
)
def test_a_line_need_not_end_and_an_empty_one_stays(text: str, lines: list[str]) -> None:
    assert json_lines(text) == lines

"""Which keys an expression covers."""

import pytest

from shared.bus.key_expressions import includes
from shared.bus.keys import Keys


@pytest.mark.parametrize(
    ("expression", "key", "covered"),
    [
        ("a/b", "a/b", True),
        ("a/b", "a/b/c", False),
        ("a/b/c", "a/b", False),
        ("a/*", "a/b", True),
        ("a/*", "a", False),
        ("a/*", "a/b/c", False),
        ("*/b", "a/b", True),
        ("a/**", "a", True),
        ("a/**", "a/b/c", True),
        ("**/c", "a/b/c", True),
        ("a/**/c", "a/c", True),
        ("a/**/c", "a/b/b/c", True),
        ("a/**/c", "a/b/b", False),
        ("**", "a/b", True),
    ],
)
def test_includes(expression: str, key: str, covered: bool) -> None:  # noqa: FBT001 - a table of examples
    assert includes(expression, key) is covered


def test_keys_of_a_room() -> None:
    keys = Keys("or1")
    assert keys.frame == "distalock/v1/or1/imaging/frame"
    assert keys.robot_command("stop") == "distalock/v1/or1/robot/command/stop"
    assert keys.heartbeat("ui_api") == "distalock/v1/or1/ui_api/heartbeat"
    assert keys.alive("robot") == "distalock/v1/or1/alive/robot"
    assert includes(keys.any_frame_by_hash, keys.frame_by_hash("0" * 64))
    assert not includes(keys.any_frame_by_hash, Keys("or2").frame_by_hash("0" * 64))

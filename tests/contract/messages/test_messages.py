"""Old messages decode for ever, and the committed schemas are those of the code."""

import json
import re
from pathlib import Path

import pytest
from pydantic import ValidationError

from shared.messages.base import MessageInvalid, decode, encode
from shared.messages.presence import Heartbeat
from shared.messages.robot import PlatformPoseMessage
from shared.messages.schema_files import differences, message_types, write
from tests.contract.messages.make_golden import GOLDEN, missing


@pytest.mark.parametrize("file", sorted(GOLDEN.glob("*.json")), ids=lambda file: file.stem)
def test_golden_message_decodes_and_survives_a_round_trip(file: Path) -> None:
    content = file.read_bytes()
    kind = message_types()[json.loads(content)["schema"]]
    message = decode(kind, content)
    assert decode(kind, encode(message)) == message


@pytest.mark.parametrize("file", sorted(GOLDEN.glob("*.json")), ids=lambda file: file.stem)
def test_unknown_keys_and_foreign_schemas_are_refused(file: Path) -> None:
    content = json.loads(file.read_bytes())
    kind = message_types()[content["schema"]]
    with pytest.raises(MessageInvalid, match=f"not a valid {kind.__name__}: surprise: Extra inputs"):
        decode(kind, json.dumps({**content, "surprise": 1}).encode())
    with pytest.raises(MessageInvalid, match=f"not a valid {kind.__name__}: schema: Input should be"):
        decode(kind, json.dumps({**content, "schema": "distalock/other/1"}).encode())


@pytest.mark.parametrize("name", ["localisation-1", "guidance-1", "calibration-1"])
def test_a_code_of_a_later_release_is_refused_by_name(name: str) -> None:
    """And so is the message with it: nothing is accepted because its reasons are not understood."""
    content = (GOLDEN / f"{name}.json").read_text()
    later = re.sub(r'("code": ?)"[a-z_]+"', r'\1"of_a_later_release"', content)
    assert later != content
    with pytest.raises(MessageInvalid, match="code: Input should be"):
        decode(message_types()[json.loads(content)["schema"]], later.encode())


def test_every_message_has_a_golden_one() -> None:
    assert missing() == [], "run python -m tests.contract.messages.make_golden and commit"


def test_committed_schemas_are_those_of_the_code() -> None:
    assert differences() == []


def test_schemas_that_differ_are_named(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "frame-1.json").write_text("{}", encoding="utf-8")
    (tmp_path / "gone-1.json").write_text("{}", encoding="utf-8")
    (tmp_path / "plan-1.json").unlink()
    assert differences(tmp_path) == [
        "plan-1.json is missing",
        "gone-1.json belongs to no message",
        "frame-1.json is out of date",
    ]


def test_messages_cannot_be_changed() -> None:
    beat = Heartbeat(service="robot", boot_epoch="a", sequence=0)
    with pytest.raises(ValidationError, match="frozen"):
        beat.sequence = 1  # type: ignore[misc]  # the point of the test


def test_numbers_on_the_wire_are_finite() -> None:
    pose = b'{"x_mm":NaN,"y_mm":0,"z_mm":0,"u_deg":0,"v_deg":0,"w_deg":0}'
    with pytest.raises(MessageInvalid, match="not a valid PlatformPoseMessage: x_mm: Input should be a finite number"):
        decode(PlatformPoseMessage, pose)

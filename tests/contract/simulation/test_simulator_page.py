"""docs/simulator-api.md: its commands do what they say, and it has every operation and every kind of fault."""

import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from simulation.control.fault_models import RoomFault
from simulation.controller.faults import Fault
from tests.contract.simulation.test_control_api import Client
from tests.contract.simulation.test_control_api import client as client
from tools.simulator_page import simulator_page

PAGE = Path(__file__).parents[3] / "docs" / "simulator-api.md"
_ADDRESS = "http://127.0.0.1:8900"


def commands(page: str) -> Iterator[tuple[str, str, object]]:
    """Method, path and body of each command of the page."""
    for line in re.findall(r"^curl .*$", page, re.MULTILINE):
        words = shlex.split(line)
        sends = "--json" in words
        method = words[words.index("-X") + 1] if "-X" in words else "POST" if sends else "GET"
        body = json.loads(words[words.index("--json") + 1]) if sends else None
        path = next(word.removeprefix(_ADDRESS) for word in words if word.startswith(_ADDRESS))
        yield method, path, body


def test_the_commands_of_the_page_work_one_after_another(client: Client) -> None:
    found = list(commands(PAGE.read_text()))
    assert len(found) >= 10
    for method, path, body in found:
        answer = client.ask(method, path, body)
        assert answer.status_code < 300, (method, path, answer.text)


def test_the_page_has_every_operation_and_every_fault(client: Client) -> None:
    page = simulator_page()
    paths = client.app.openapi()["paths"]
    for path, methods in paths.items():
        for method, operation in methods.items():
            assert f"| `{method.upper()} {path}` | {operation['description']} |" in page
    for fault in Fault:
        assert f"| `{fault.value}` |" in page
    for kind in RoomFault.__args__:
        assert f"\n### {kind.__name__}\n" in page
    for code in ("no_shot_yet", "hole_unknown", "c_arm_out_of_reach", "image_not_delivered", "invalid_request"):
        assert f"`{code}` |" in page

"""What the doctor asks of what runs: a virtual controller, a DICOM receiver, a gateway's readyz."""

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest
from pynetdicom import AE
from pynetdicom.sop_class import Verification  # type: ignore[attr-defined]  # made at run time

from distalock.doctor.command import exit_code, table_of
from distalock.doctor.running import controller_finding, dicom_finding, gateway_findings, ports_finding
from distalock.local_ports import free_ports
from distalock.readiness import Server
from services.imaging.settings import ImagingSettings
from services.robot.settings import RobotSettings
from shared.doctor.finding import Finding, Verdict, attention, unknown, well, wrong
from shared.parts.hexapod_file import default_hexapod
from simulation.controller.servers import tcp_server
from simulation.controller.virtual_controller import VirtualController

SETTINGS = RobotSettings()
CHECKS = [
    {"name": "robot_state", "ok": True, "measured": "locked", "remedy": ""},
    {"name": "frames", "ok": True, "measured": "frames by shared memory 0, by TCP 9", "remedy": "see the logs"},
    {"name": "database", "ok": False, "measured": "database is locked", "remedy": "see who holds it"},
]


class ReadyZ(BaseHTTPRequestHandler):
    """A gateway that has only this to say."""

    def do_GET(self) -> None:
        content = json.dumps({"checks": CHECKS}).encode()
        self.send_response(503)
        self.send_header("content-length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Nothing to the terminal."""


@contextmanager
def gateway() -> Iterator[str]:
    with HTTPServer(("127.0.0.1", 0), ReadyZ) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


def free_port() -> int:
    (port,) = free_ports(1)
    return port


def test_each_check_of_a_gateway_is_a_finding_with_its_remedy() -> None:
    with gateway() as url:
        found = list(gateway_findings(Server(url)))
    assert found == [
        well("running: robot state", "locked"),
        attention("running: frames", "frames by shared memory 0, by TCP 9", "see the logs"),
        wrong("running: database", "database is locked", "see who holds it"),
    ]


def test_without_a_gateway_nothing_was_looked_at() -> None:
    (found,) = gateway_findings(Server(f"http://127.0.0.1:{free_port()}"))
    assert found.verdict is Verdict.UNKNOWN


def test_a_controller_says_who_it_is() -> None:
    controller = VirtualController(default_hexapod(), time.monotonic)
    with tcp_server(controller) as port:
        found = controller_finding(f"socket://127.0.0.1:{port}", SETTINGS, running=False)
    assert found.verdict is Verdict.WELL
    assert "imulat" in found.measured


def test_a_controller_whose_line_is_held_or_that_is_not_there() -> None:
    url = f"socket://127.0.0.1:{free_port()}"
    assert controller_finding(url, SETTINGS, running=True).verdict is Verdict.UNKNOWN
    assert controller_finding(None, SETTINGS, running=False).verdict is Verdict.UNKNOWN
    missing = controller_finding(url, SETTINGS, running=False)
    assert (missing.verdict, url in missing.measured) == (Verdict.WRONG, True)


def test_dicom_reception_that_is_not_there() -> None:
    settings = ImagingSettings(dicom_port=free_port())
    assert dicom_finding(settings, running=True).verdict is Verdict.WRONG
    assert dicom_finding(settings, running=False).verdict is Verdict.UNKNOWN


def test_dicom_reception_answers_an_echo() -> None:
    entity = AE(ae_title="DISTALOCK")
    entity.add_supported_context(Verification)
    server = entity.start_server(("127.0.0.1", 0), block=False)
    assert server is not None
    try:
        found = dicom_finding(ImagingSettings(dicom_port=server.server_address[1]), running=True)
    finally:
        server.shutdown()
    assert found.verdict is Verdict.WELL, found


def test_a_port_that_another_program_holds_is_named() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        number = int(other.getsockname()[1])
        held = ports_finding({"REST": number}, running=False)
        assert (held.verdict, f"{number} (REST)" in held.measured) == (Verdict.WRONG, True)
        assert ports_finding({"REST": number}, running=True).verdict is Verdict.WELL
    assert ports_finding({"REST": number}, running=False).verdict is Verdict.WELL


@pytest.mark.parametrize(
    ("findings", "code"),
    [
        ((well("a", "b"), unknown("c", "d")), 0),
        ((well("a", "b"), attention("c", "d", "e")), 3),
        ((wrong("a", "b", "c"), attention("c", "d", "e")), 1),
    ],
)
def test_the_exit_code_is_that_of_the_worst(findings: tuple[Finding, ...], code: int) -> None:
    assert exit_code(findings) == code
    assert table_of(findings).row_count == len(findings)

"""The virtual operating room as a process: it starts, answers, and ends; or says in one sentence why it cannot."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

RANGES = '{"c_arm": {"size_px": 256, "pixel_mm": [0.94, 0.94]}}'
SCENARIO = f'{{"schema": "distalock/scenario/1", "seed": 4, "ranges": {RANGES}}}'
START_WITHIN_S = 120.0
END_WITHIN_S = 60.0


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "simulation", "--gcs-port", "0", "--control-port", "0", *arguments]


@pytest.fixture(scope="module")
def scenario_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scenario") / "small.json"
    file.write_text(SCENARIO)
    return file


@pytest.fixture
def running(scenario_file: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The process and its first line, which it writes when it is ready."""
    process = subprocess.Popen(command("--scenario", str(scenario_file)), stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process, process.stdout.readline()
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def test_it_says_where_it_answers_and_does(running: tuple[subprocess.Popen[str], str]) -> None:
    _, line = running
    found = re.search(r"seed 4: hexapod controller at 127\.0\.0\.1:(\d+) and (/dev/\S+), control at (\S+),", line)
    assert found, line
    assert httpx.get(f"{found[3]}/healthz").json() == {"status": "ok", "simulated": True}
    shot = httpx.post(f"{found[3]}/shots", timeout=START_WITHIN_S)
    assert shot.status_code == 201
    with socket.create_connection(("127.0.0.1", int(found[1])), timeout=START_WITHIN_S) as controller:
        controller.sendall(b"*IDN?\n")
        assert b"imulat" in controller.recv(200)
    assert Path(found[2]).exists()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_cleanly(running: tuple[subprocess.Popen[str], str], number: signal.Signals) -> None:
    process, line = running
    assert line
    os.kill(process.pid, number)
    assert process.wait(END_WITHIN_S) == 0


@pytest.mark.parametrize("option", ["--control-port", "--gcs-port"])
def test_a_port_in_use_is_one_sentence(option: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        ended = subprocess.run(
            command(option, port), capture_output=True, text=True, timeout=START_WITHIN_S, check=False
        )
    assert ended.returncode == 2
    assert len(ended.stderr.strip().splitlines()) == 1
    assert f"cannot listen at 127.0.0.1:{port}" in ended.stderr


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--scenario", "none.json"), "file none.json does not exist"),
        (("--dicom-target", "nowhere"), "'nowhere' is no DICOM target"),
        (("--seed", "1", "--scenario", __file__), "argument --scenario: not allowed with argument --seed"),
    ],
)
def test_wrong_arguments_are_one_sentence(arguments: tuple[str, ...], sentence: str) -> None:
    ended = subprocess.run(command(*arguments), capture_output=True, text=True, timeout=START_WITHIN_S, check=False)
    assert ended.returncode == 2
    assert sentence in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1

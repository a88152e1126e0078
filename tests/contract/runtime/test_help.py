"""Every program answers `--help` and refuses unknown arguments, and starts nothing for either."""

import subprocess
import sys

import pytest

from tests.contract.bus.rooms import PATIENCE_S

MODULES = ["services.imaging", "services.registration", "services.robot", "services.ui_api", "simulation"]


def run(module: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    # No router listens there: a program that started anything would wait for it, and end with another sentence.
    return subprocess.run(
        [sys.executable, "-m", module, *arguments],
        env={"DISTALOCK_ROUTER_ENDPOINT": "tcp/127.0.0.1:9", "DISTALOCK_ROUTER_TIMEOUT_S": "0.1", "HOME": "/tmp"},
        capture_output=True,
        text=True,
        timeout=6 * PATIENCE_S,
        check=False,
    )


@pytest.mark.parametrize("module", [*MODULES, "shared.bus.router"])
def test_help_is_printed_and_nothing_starts(module: str) -> None:
    ran = run(module, "--help")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.startswith(f"usage: python -m {module}")
    if module.startswith("services."):
        assert "DISTALOCK_ROUTER_ENDPOINT" in ran.stdout


@pytest.mark.parametrize("module", ["services.robot", "services.ui_api", "simulation"])
def test_an_unknown_argument_is_one_line_and_2(module: str) -> None:
    ran = run(module, "--no-such-argument")
    assert (ran.returncode, ran.stdout) == (2, "")
    assert ran.stderr == (
        f"python -m {module}: unrecognized arguments: --no-such-argument (see python -m {module} --help)\n"
    )

"""A fleet of processes: order, readiness, last words, ports."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from distalock.local_ports import free_ports
from distalock.processes import MOST_OUTPUT_BYTES, Fleet, ProcessSpec
from shared.errors import ConfigurationError


def write_module(folder: Path, name: str, body: str) -> None:
    (folder / f"{name}.py").write_text(body)


def spec(folder: Path, name: str) -> ProcessSpec:
    return ProcessSpec(name, name, lambda: True, environment={"PYTHONPATH": str(folder)})


def never_ready(folder: Path, name: str) -> ProcessSpec:
    return ProcessSpec(name, name, lambda: False, environment={"PYTHONPATH": str(folder)})


WAITS = """\
import signal, sys
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
print("up", flush=True)
signal.pause()
"""


def test_starts_all_and_leaves_none_behind(tmp_path: Path) -> None:
    write_module(tmp_path, "one", WAITS)
    write_module(tmp_path, "two", WAITS)
    with Fleet([spec(tmp_path, "one"), spec(tmp_path, "two")], tmp_path / "logs") as fleet:
        pids = fleet.pids
        assert set(pids) == {"one", "two"}
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids.values())


def test_says_what_the_process_said_when_it_did_not_start(tmp_path: Path) -> None:
    write_module(tmp_path, "dies", "import sys\nsys.exit('the tube is cold')\n")
    with (
        pytest.raises(ConfigurationError, match="dies did not start: the tube is cold"),
        Fleet([never_ready(tmp_path, "dies")], tmp_path / "logs"),
    ):
        pytest.fail("entered a fleet that did not start")


def test_gives_up_on_a_process_that_is_never_ready(tmp_path: Path) -> None:
    write_module(tmp_path, "slow", WAITS)
    with (
        pytest.raises(ConfigurationError, match=r"slow was not ready after 1 s; see .*slow\.log"),
        Fleet([never_ready(tmp_path, "slow")], tmp_path / "logs", start_patience_s=1.0),
    ):
        pytest.fail("entered a fleet that did not start")


def test_names_the_process_that_ended_by_itself(tmp_path: Path) -> None:
    write_module(tmp_path, "ends", "print('last words')\n")
    with Fleet([spec(tmp_path, "ends")], tmp_path / "logs") as fleet:
        assert fleet.wait_until_one_ends() == "ends"
        assert fleet.last_words("ends") == "last words"


def test_a_stop_event_ends_the_waiting(tmp_path: Path) -> None:
    write_module(tmp_path, "one", WAITS)
    stop = threading.Event()
    stop.set()
    with Fleet([spec(tmp_path, "one")], tmp_path / "logs", stop=stop) as fleet:
        assert fleet.wait_until_one_ends() is None


def test_a_stop_event_ends_the_starting(tmp_path: Path) -> None:
    write_module(tmp_path, "slow", WAITS)
    stop = threading.Event()
    stop.set()
    with (
        pytest.raises(ConfigurationError, match="interrupted while slow was starting"),
        Fleet([never_ready(tmp_path, "slow")], tmp_path / "logs", stop=stop),
    ):
        pytest.fail("entered a fleet that was interrupted")


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(ConfigurationError, match=r"cannot be written \(Not a directory\); choose another with --state"):
        Fleet([], tmp_path / "file" / "logs").__enter__()


def test_a_folder_in_use_is_refused_and_free_again_afterwards(tmp_path: Path) -> None:
    with (
        Fleet([], tmp_path / "logs"),
        pytest.raises(ConfigurationError, match="is in use by another installation that runs now"),
    ):
        Fleet([], tmp_path / "logs").__enter__()
    with Fleet([], tmp_path / "logs"):
        pass


NOTICES = """\
import os, pathlib, sys, threading
from shared.signals import set_by_signals
stop = threading.Event()
with set_by_signals(stop):
    pathlib.Path(sys.argv[0]).with_suffix(".pid").write_text(str(os.getpid()))
    stop.wait()
pathlib.Path(sys.argv[0]).with_suffix(".left").write_text("cleanly")
"""
KILLED = """\
import os, pathlib, signal, sys, time
from distalock.processes import MOST_OUTPUT_BYTES, Fleet, ProcessSpec
folder = pathlib.Path(sys.argv[1])
spec = ProcessSpec("notices", "notices", (folder / "notices.pid").exists, environment={"PYTHONPATH": sys.argv[2]})
with Fleet([spec], folder / "logs"):
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.requirement("OPS-01")
def test_processes_end_when_what_started_them_is_killed(tmp_path: Path) -> None:
    write_module(tmp_path, "notices", NOTICES)
    path = os.pathsep.join([str(tmp_path), *sys.path])
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path), path], env={**os.environ, "PYTHONPATH": path}, check=False
    )
    assert killed.returncode == -signal.SIGKILL
    deadline_s = time.monotonic() + 60.0
    while not (tmp_path / "notices.left").exists():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def test_what_a_process_prints_has_a_bounded_size(tmp_path: Path) -> None:
    write_module(tmp_path, "one", WAITS)
    with Fleet([spec(tmp_path, "one")], tmp_path / "logs") as fleet:
        file = tmp_path / "logs" / "one.log"
        with file.open("ab") as output:
            output.write(b"x" * (MOST_OUTPUT_BYTES + 1))
        fleet._cut_output()
        assert file.stat().st_size == 0


def test_a_reserved_port_is_refused_before_anything_is_started(tmp_path: Path) -> None:
    write_module(tmp_path, "one", WAITS)
    number = f"port {free_ports(1)[0]}"
    with (
        Fleet([], tmp_path / "first", reservations={number: ""}),
        pytest.raises(ConfigurationError, match="is used by another installation that runs now; choose another"),
        Fleet([spec(tmp_path, "one")], tmp_path / "second", reservations={number: "choose another"}),
    ):
        pytest.fail("entered a fleet whose port is another's")
    assert not (tmp_path / "second" / "one.log").exists()


def test_a_process_that_ends_while_another_starts_is_named(tmp_path: Path) -> None:
    write_module(tmp_path, "dies", "import sys\nsys.exit('the tube is cold')\n")
    write_module(tmp_path, "slow", WAITS)
    with (
        pytest.raises(ConfigurationError, match="dies did not start: the tube is cold"),
        Fleet([spec(tmp_path, "dies"), never_ready(tmp_path, "slow")], tmp_path / "logs"),
    ):
        pytest.fail("entered a fleet that did not start")

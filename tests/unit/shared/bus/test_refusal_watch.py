"""The pipe that takes Zenoh's log must never make the router wait."""

import json
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

from shared.bus.refusal_watch import log_line
from shared.bus.tls import TlsFiles
from shared.messages.refusals import BusRefusal, RefusalCode
from shared.pki.keystore import ROUTER, Keystore

NOBODY_READS = """
import os
from shared.bus.refusal_watch import captured_log
written = 0
with captured_log() as log:
    try:
        while written < 2**24:
            written += os.write(1, b"x" * 100 + b"\\n")
    except BlockingIOError:
        pass
    lines = list(log.lines())
    again = list(log.lines())
    os.write(1, b"one more\\n")
    (more,) = log.lines()
    log.write(f"{len(lines) == written // 101} {again} {more}")
os.write(1, b"as before\\n")
"""


def test_a_full_pipe_loses_lines_and_keeps_nobody_waiting() -> None:
    ended = subprocess.run([sys.executable, "-c", NOBODY_READS], capture_output=True, text=True, check=True)
    assert ended.stdout == "True [] one more\nas before\n"


def test_a_refusal_is_a_line_of_json_whatever_its_key_holds() -> None:
    refusal = BusRefusal(
        code=RefusalCode.MESSAGE_DENIED, service="imaging", what="Put", key="a\nb", times=2, last_at_ns=10**18
    )
    line = log_line(refusal)
    assert "\n" not in line
    assert json.loads(line) | {"timestamp": ""} == {
        "level": "warning",
        "event": "refused",
        "timestamp": "",
        "code": "message_denied",
        "service": "imaging",
        "what": "Put",
        "key": "a\nb",
        "times": 2,
    }


A_LOOP_ENDS = """
import sys
from shared.bus import router
from shared.bus.refusal_watch import RouterLog


def broken(*_):
    raise OSError("the pipe is gone")


RouterLog.wait = broken
sys.exit(router.main(sys.argv[1:]))
"""


def test_a_router_whose_watch_has_ended_ends(tmp_path: Path) -> None:
    keystore = Keystore(tmp_path)
    keystore.ensure(datetime.now(UTC))
    files = TlsFiles.in_folder(keystore.folder_of(ROUTER))
    words = ["--authority", str(files.authority), "--certificate", str(files.certificate), "--key", str(files.key)]
    command = [sys.executable, "-c", A_LOOP_ENDS, *words, "--listen", "tls/127.0.0.1:0"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60.0)
    assert ended.returncode == 1
    assert "the pipe is gone" in ended.stderr

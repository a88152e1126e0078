"""The gateway's command: what cannot start says so in one sentence, with exit code 2."""

import json
from pathlib import Path

import pytest

from services.ui_api.__main__ import main
from services.ui_api.front.port import listening_socket
from shared.errors import ConfigurationError


def test_a_port_in_use_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with listening_socket("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        assert main(["--port", str(port), "--state-dir", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"cannot listen on 127.0.0.1 port {port} (Address already in use)" in said
    assert list(tmp_path.iterdir()) == [], "nothing is begun"


def test_an_address_of_another_machine_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"cannot listen on 192\.0\.2\.1 port 0"):
        listening_socket("192.0.2.1", 0)


def test_a_wrong_setting_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--port", "70000"]) == 2
    assert "setting 'port': Input should be less than or equal to 65535" in capsys.readouterr().err


def test_openapi_prints_the_document(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["openapi"]) == 0
    assert "/api/v1/cases" in json.loads(capsys.readouterr().out)["paths"]

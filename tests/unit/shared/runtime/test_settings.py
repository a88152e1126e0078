"""Where settings come from, which goes first, and what wrong ones say.

The process environment is the source under test; each test starts a fresh interpreter with the environment it needs.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

from shared.bus.tls import TlsFiles
from shared.runtime.settings import ServiceSettings, bus_settings

PROGRAM = """
import json, os, sys
from typing import ClassVar
from shared.errors import ConfigurationError
from shared.runtime.settings import ServiceSettings, load_settings

class Example(ServiceSettings):
    section: ClassVar[str] = "imaging"
    port: int = 104

results = []
for environment, room in json.load(sys.stdin):
    os.environ.update(environment)
    try:
        results.append(load_settings(Example, room=room).model_dump(mode="json"))
    except ConfigurationError as error:
        results.append(str(error))
    for name in environment:
        del os.environ[name]
json.dump(results, sys.stdout)
"""
Case = tuple[dict[str, str], str | None]


def load(*cases: Case) -> list[dict[str, object] | str]:
    """Settings, or the error's sentence, for each environment and `room` argument."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("DISTALOCK_")}
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM], input=json.dumps(cases), env=clean, capture_output=True, text=True, check=True
    )
    results: list[dict[str, object] | str] = json.loads(ran.stdout)
    return results


def rooms(*cases: Case) -> list[object]:
    return [result if isinstance(result, str) else result["room"] for result in load(*cases)]


def config(folder: Path, text: str, name: str = "distalock.toml") -> dict[str, str]:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return {"DISTALOCK_CONFIG": str(file)}


def test_defaults_need_nothing() -> None:
    (loaded,) = load(({}, None))
    assert isinstance(loaded, dict)
    assert loaded["room"] == "or1"
    assert loaded["router_endpoint"] == "tls/127.0.0.1:7447"
    assert loaded["port"] == 104


def test_the_nearer_source_goes_first(tmp_path: Path) -> None:
    top = config(tmp_path, 'room = "file"\n', "top.toml")
    table = config(tmp_path, 'room = "file"\n[imaging]\nroom = "table"\n[robot]\nsecret = 1\n', "table.toml")
    common = {**table, "DISTALOCK_ROOM": "common"}
    own = {**common, "DISTALOCK_IMAGING_ROOM": "own"}
    found = rooms((top, None), (table, None), (common, None), (own, None), (own, "argument"))
    assert found == ["file", "table", "common", "own", "argument"]


def test_wrong_settings_are_one_sentence(tmp_path: Path) -> None:
    texts = ["colour = 1", "[imagine]", "port = 'x'", "room = "]
    files: list[Case] = [(config(tmp_path, text, f"{number}.toml"), None) for number, text in enumerate(texts)]
    missing: Case = ({"DISTALOCK_CONFIG": str(tmp_path / "none.toml")}, None)
    sentences = [
        "setting 'colour': Extra inputs are not permitted, got 1",
        f"{tmp_path}/1.toml: unknown table [imagine]; known are imaging, registration, robot, simulation, ui_api",
        "setting 'port': Input should be a valid integer, unable to parse string as an integer, got 'x'",
        f"{tmp_path}/3.toml: not TOML: Invalid value (at end of document)",
        f"{tmp_path}/none.toml: cannot be read: No such file or directory",
        "setting 'room': String should match pattern '^[A-Za-z0-9][A-Za-z0-9._-]*$', got 'a/b'",
    ]
    assert rooms(*files, missing, ({"DISTALOCK_ROOM": "a/b"}, None)) == sentences


def test_certificates_lie_in_the_state_folder_unless_they_are_named(tmp_path: Path) -> None:
    settings = ServiceSettings(state_dir=tmp_path, router_endpoint="tls/router:7447", tls_key=tmp_path / "secret")
    found = bus_settings("robot", settings)
    folder = tmp_path / "pki" / "robot"
    assert found.tls == TlsFiles(folder / "authority.pem", folder / "certificate.pem", tmp_path / "secret")
    assert found.endpoint == "tls/router:7447"


def test_an_endpoint_without_tls_needs_no_certificates(tmp_path: Path) -> None:
    settings = ServiceSettings(state_dir=tmp_path, router_endpoint="tcp/router:7447")
    assert bus_settings("robot", settings).tls is None

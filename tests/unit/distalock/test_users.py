"""`distalock users`: accounts without a gateway; and the simulation's token."""

import io
from pathlib import Path

import pytest

from distalock.__main__ import main
from distalock.demo_user import TOKEN_FILE, demo_token
from distalock.processes import taken_folder
from services.ui_api.record.database import existing_database, sole_gateway, sqlite_url
from services.ui_api.record.verify import verify_record

PASSWORD = "four words and a nail"


def users(state: Path, monkeypatch: pytest.MonkeyPatch, *words: str, password: str = PASSWORD) -> int:
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{password}\n"))
    asked = ("--password-stdin",) if words[0] in ("add", "password") else ()
    return main(["users", *words, *asked, "--state", str(state)])


def test_accounts_are_made_changed_and_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert users(tmp_path, monkeypatch, "add", "nora", "--role", "administrator") == 0
    assert users(tmp_path, monkeypatch, "add", "otto", "--role", "surgeon", "--role", "technician") == 0
    assert users(tmp_path, monkeypatch, "roles", "otto", "--role", "viewer") == 0
    assert users(tmp_path, monkeypatch, "password", "otto", password="quite another sentence") == 0
    assert users(tmp_path, monkeypatch, "disable", "otto") == 0
    capsys.readouterr()
    assert users(tmp_path, monkeypatch, "list") == 0
    assert capsys.readouterr().out == "nora  administrator\notto  viewer  disabled\n"
    record = existing_database(sqlite_url(tmp_path))
    assert getattr(verify_record(record), "entries", None) == 5, "every change is an event"
    record.dispose()


@pytest.mark.parametrize(
    ("words", "password", "why"),
    [
        (("add", "nora", "--role", "viewer"), "short", "the password has 5 characters, and must have 12 to 128"),
        (("add", "gateway", "--role", "viewer"), PASSWORD, "the name 'gateway' is a service's"),
        (("add", "Nora Smith", "--role", "viewer"), PASSWORD, "'Nora Smith' is no account's name"),
        (("enable", "nobody"), PASSWORD, "there is no user 'nobody'"),
    ],
)
def test_what_cannot_be_done_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    password: str,
    why: str,
) -> None:
    assert users(tmp_path, monkeypatch, *words, password=password) == 2
    assert why in capsys.readouterr().err


def test_beside_a_gateway_nothing_is_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with sole_gateway(sqlite_url(tmp_path)):
        assert users(tmp_path, monkeypatch, "add", "nora", "--role", "viewer") == 2
    assert "held by another gateway that runs now" in capsys.readouterr().err


def test_the_token_is_random_private_and_stays(tmp_path: Path) -> None:
    token = demo_token(tmp_path / "one")
    assert demo_token(tmp_path / "one") == token != demo_token(tmp_path / "two")
    assert (tmp_path / "one" / TOKEN_FILE).stat().st_mode & 0o077 == 0


def test_beside_a_running_installation_only_its_token_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with taken_folder(tmp_path / "logs"):
        assert main(["up", "--simulate", "--print-token", "--state", str(tmp_path)]) == 0
    assert capsys.readouterr() == (f"{demo_token(tmp_path)}\n", "")
    assert main(["up", "--controller", "/dev/null", "--print-token", "--state", str(tmp_path)]) == 2
    assert "--print-token belongs to --simulate" in capsys.readouterr().err

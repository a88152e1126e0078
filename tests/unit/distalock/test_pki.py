"""`distalock pki`: what it prints, and when it refuses."""

from contextlib import closing
from pathlib import Path

import pytest

from distalock.__main__ import main
from distalock.processes import taken_folder
from shared.pki.keystore import ISSUED
from shared.pki.network import NETWORK


def pki(state: Path, *words: str) -> int:
    return main(["pki", *words, "--state", str(state)])


def test_init_makes_a_certificate_for_everybody_and_show_lists_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pki(tmp_path, "init") == 0
    made = capsys.readouterr().out.splitlines()
    authorities = [number for number, line in enumerate(made) if line.startswith("distalock authority")]
    assert authorities == [0, len(ISSUED) + 1]
    certificates = [line for line in made[:-1] if not line.startswith("distalock authority")]
    assert [line.split()[0] for line in certificates] == [*ISSUED, *NETWORK]
    assert all("new, until" in line for line in certificates)
    assert made[-1].startswith("Start the installation again")
    assert pki(tmp_path, "show") == 0
    shown = capsys.readouterr().out.splitlines()
    assert [shown[number] for number in authorities] == [made[number] for number in authorities]
    assert len([line for line in shown if "valid, until" in line]) == len(certificates)
    assert len(shown) == len(made) - 1


def test_init_a_second_time_changes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pki(tmp_path, "init")
    pki(tmp_path, "init")
    assert "new, until" not in capsys.readouterr().out.split("Start the installation again")[1]


def test_issue_changes_the_named_and_rotate_everybody(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pki(tmp_path, "init")
    capsys.readouterr()
    pki(tmp_path, "issue", "robot", "ui_api")
    new = [line.split()[0] for line in capsys.readouterr().out.splitlines() if "new, until" in line]
    assert new == ["robot", "ui_api"]
    pki(tmp_path, "rotate", "--router-host", "or1.local")
    printed = capsys.readouterr().out
    assert printed.count("new, until") == len(ISSUED) + len(NETWORK)
    assert printed.count("or1.local") == 1
    pki(tmp_path, "rotate", "--only", "network", "--network-host", "or1.hospital")
    printed = capsys.readouterr().out
    assert [line.split()[0] for line in printed.splitlines() if "new, until" in line] == list(NETWORK)
    assert printed.count("or1.hospital") == 2
    assert pki(tmp_path, "issue", "c_arm", "robot", "nobody") == 2
    assert "nobody is called 'nobody' here; known are router, " in capsys.readouterr().err
    pki(tmp_path, "issue", "c_arm", "robot")
    new = [line.split()[0] for line in capsys.readouterr().out.splitlines() if "new, until" in line]
    assert new == ["robot", "c_arm"]


def test_show_ends_with_three_when_something_is_to_be_done(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pki(tmp_path, "init")
    (tmp_path / "pki" / "robot" / "certificate.pem").unlink()
    assert pki(tmp_path, "show") == 3
    assert "robot        missing\n" in capsys.readouterr().out


def test_nothing_is_changed_under_a_running_installation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with closing(taken_folder(tmp_path / "logs")):
        assert pki(tmp_path, "rotate") == 2
    assert "is in use by another installation that runs now; end it" in capsys.readouterr().err
    assert not (tmp_path / "pki").exists()


def test_show_without_an_authority_names_the_remedy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert pki(tmp_path, "show") == 2
    assert capsys.readouterr().err == (
        f"distalock pki: there is no authority in {tmp_path}/pki; make one (distalock pki init)\n"
    )

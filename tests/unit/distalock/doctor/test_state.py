"""What the doctor says of a state folder and of settings."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from distalock.doctor.settings import settings_finding
from shared.bus.tls import PKI_FOLDER
from shared.doctor.finding import Verdict
from shared.doctor.state import state_findings
from shared.parts.approvals import APPROVALS_FILE
from shared.pki.keystore import Keystore
from shared.pki.network import network_keystore

NOW = datetime(2026, 11, 25, tzinfo=UTC)


@pytest.fixture
def state(tmp_path: Path) -> Path:
    for keystore in (Keystore, network_keystore):
        keystore(tmp_path / PKI_FOLDER).ensure(NOW)
    return tmp_path


def test_a_folder_where_nothing_was_started_was_not_looked_at(tmp_path: Path) -> None:
    certificates, parts = state_findings(tmp_path, NOW)
    assert (certificates.verdict, parts.verdict) == (Verdict.UNKNOWN, Verdict.WELL)


def test_fresh_certificates_are_well(state: Path) -> None:
    assert [finding.verdict for finding in state_findings(state, NOW)] == [Verdict.WELL] * 3


def test_certificates_that_end_soon_need_attention_and_an_ended_authority_is_wrong(state: Path) -> None:
    bus, *_ = state_findings(state, NOW + timedelta(days=300))
    assert (bus.verdict, "renewal due" in bus.measured) == (Verdict.ATTENTION, True)
    bus, *_ = state_findings(state, NOW + timedelta(days=50_000))
    assert (bus.verdict, bus.remedy) == (Verdict.WRONG, "`distalock pki rotate`")


def test_a_certificate_of_another_authority_is_wrong(state: Path, tmp_path: Path) -> None:
    other = Keystore(tmp_path / "other")
    other.ensure(NOW)
    for file in (state / PKI_FOLDER / "imaging").iterdir():
        file.write_bytes((other.folder_of("imaging") / file.name).read_bytes())
    bus, *_ = state_findings(state, NOW)
    assert bus.verdict is Verdict.WRONG
    assert "imaging" in bus.measured
    assert "imaging" in bus.remedy


def test_approvals_that_cannot_be_read_are_wrong(state: Path) -> None:
    (state / APPROVALS_FILE).write_text("{half a line")
    *_, parts = state_findings(state, NOW)
    assert parts.verdict is Verdict.WRONG


def test_a_misspelt_variable_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    assert settings_finding().verdict is Verdict.WELL
    monkeypatch.setenv("DISTALOCK_ROBOT_CONTROLER_URL", "/dev/ttyUSB0")
    found = settings_finding()
    assert found.verdict is Verdict.WRONG
    assert "did you mean DISTALOCK_ROBOT_CONTROLLER_URL?" in found.measured

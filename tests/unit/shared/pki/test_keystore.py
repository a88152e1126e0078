"""The folder of keys: what is made, what stays, what is made anew, and who can read it."""

import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from shared.bus.tls import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, TlsFiles
from shared.errors import ConfigurationError
from shared.pki.authority import AUTHORITY_VALID, CERTIFICATE_VALID
from shared.pki.keystore import ISSUED, NAMES, PERMIT, RENEW_BEFORE, ROUTER, Keystore, Standing
from shared.pki.permit_key import PERMIT_CERTIFICATE_FILE, PERMIT_KEY_FILE

NOW = datetime(2026, 3, 1, 12, tzinfo=UTC)
DAY = timedelta(days=1)


@pytest.fixture
def keystore(tmp_path: Path) -> Keystore:
    made = Keystore(tmp_path / "pki")
    assert made.ensure(NOW) == ISSUED
    return made


def standings(keystore: Keystore, now: datetime = NOW) -> dict[str, Standing]:
    return {entry.name: entry.standing for entry in keystore.entries(now)}


def test_everybody_has_a_valid_certificate_and_it_stays(keystore: Keystore) -> None:
    before = keystore.entries(NOW)
    assert set(standings(keystore).values()) == {Standing.VALID}
    assert keystore.ensure(NOW + DAY) == ()
    assert keystore.entries(NOW) == before


def test_nobody_but_the_owner_can_read_a_key(keystore: Keystore) -> None:
    keys = [*keystore.folder.rglob(KEY_FILE), *keystore.folder.rglob(PERMIT_KEY_FILE)]
    assert len(keys) == len(ISSUED) + 1
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}
    assert {stat.S_IMODE(key.parent.stat().st_mode) for key in keys} == {0o700}


def test_a_service_finds_all_it_needs_in_its_folder_and_no_other_key(keystore: Keystore) -> None:
    folder = keystore.folder_of("imaging")
    TlsFiles.in_folder(folder).require()
    assert sorted(file.name for file in folder.iterdir()) == [AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE]
    for name in NAMES:
        TlsFiles.in_folder(keystore.folder_of(name)).require()


def test_the_gateway_alone_has_the_permit_key_and_the_robot_its_certificate(keystore: Keystore) -> None:
    assert [f.parent.name for f in keystore.folder.rglob(PERMIT_KEY_FILE)] == ["ui_api"]
    assert [f.parent.name for f in keystore.folder.rglob(PERMIT_CERTIFICATE_FILE)] == ["robot"]
    before = (keystore.folder_of("robot") / CERTIFICATE_FILE).read_bytes()
    assert keystore.issue((PERMIT,), NOW) == (PERMIT,)
    assert (keystore.folder_of("robot") / CERTIFICATE_FILE).read_bytes() == before


def test_an_installation_of_before_permits_gets_its_key_at_the_next_start(keystore: Keystore) -> None:
    (keystore.folder_of("ui_api") / PERMIT_KEY_FILE).unlink()
    (keystore.folder_of("robot") / PERMIT_CERTIFICATE_FILE).unlink()
    assert standings(keystore)[PERMIT] is Standing.MISSING
    assert keystore.ensure(NOW) == (PERMIT,)


def test_a_permit_key_of_another_certificate_is_made_anew(keystore: Keystore) -> None:
    key = (keystore.folder_of("ui_api") / PERMIT_KEY_FILE).read_bytes()
    keystore.issue((PERMIT,), NOW)
    (keystore.folder_of("ui_api") / PERMIT_KEY_FILE).write_bytes(key)
    assert standings(keystore)[PERMIT] is Standing.OTHER_KEY
    assert keystore.ensure(NOW) == (PERMIT,)


def test_certificates_are_renewed_half_a_year_before_they_end(keystore: Keystore) -> None:
    due = NOW + CERTIFICATE_VALID - RENEW_BEFORE
    assert keystore.ensure(due - DAY) == ()
    assert set(standings(keystore, due + DAY).values()) == {Standing.RENEWAL_DUE}
    authority = keystore.authority_facts()
    assert keystore.ensure(due + DAY) == ISSUED
    assert keystore.authority_facts() == authority
    assert set(standings(keystore, due + DAY).values()) == {Standing.VALID}


def test_what_has_ended_or_not_begun_is_expired_and_made_anew(keystore: Keystore) -> None:
    late = NOW + CERTIFICATE_VALID + DAY
    assert set(standings(keystore, late).values()) == {Standing.EXPIRED}
    assert set(standings(keystore, NOW - DAY).values()) == {Standing.EXPIRED}
    assert keystore.ensure(late) == ISSUED


def test_an_authority_ends_no_earlier_than_what_it_issues(keystore: Keystore) -> None:
    before = keystore.authority_facts()
    late = NOW + AUTHORITY_VALID - CERTIFICATE_VALID + DAY
    assert keystore.ensure(late) == ISSUED
    assert keystore.authority_facts().fingerprint != before.fingerprint


def test_one_lost_key_is_made_anew_and_the_others_stay(keystore: Keystore) -> None:
    (keystore.folder_of("robot") / KEY_FILE).unlink()
    assert standings(keystore)["robot"] is Standing.MISSING
    before = {e.name: e.facts for e in keystore.entries(NOW)}
    assert keystore.ensure(NOW) == ("robot",)
    changed = {e.name for e in keystore.entries(NOW) if e.facts != before[e.name]}
    assert changed == {"robot"}


def test_after_rotation_nothing_of_before_is_accepted(keystore: Keystore, tmp_path: Path) -> None:
    stolen = (keystore.folder_of("robot") / CERTIFICATE_FILE).read_bytes()
    stolen_key = (keystore.folder_of("robot") / KEY_FILE).read_bytes()
    assert keystore.rotate(NOW) == ISSUED
    assert set(standings(keystore).values()) == {Standing.VALID}
    (keystore.folder_of("robot") / CERTIFICATE_FILE).write_bytes(stolen)
    (keystore.folder_of("robot") / KEY_FILE).write_bytes(stolen_key)
    assert standings(keystore)["robot"] is Standing.OTHER_AUTHORITY
    assert keystore.ensure(NOW) == ("robot",)


def test_a_rotation_that_broke_off_is_completed(keystore: Keystore) -> None:
    """A crash before the last certificate leaves services that trust the authority of before."""
    old = (keystore.folder_of("ui_api") / AUTHORITY_FILE).read_bytes()
    keystore.rotate(NOW)
    (keystore.folder_of("ui_api") / AUTHORITY_FILE).write_bytes(old)
    assert standings(keystore)["ui_api"] is Standing.OTHER_AUTHORITY
    assert keystore.ensure(NOW) == ("ui_api",)


def test_a_crash_between_key_and_certificate_is_repaired(keystore: Keystore) -> None:
    other = (keystore.folder_of("imaging") / KEY_FILE).read_bytes()
    (keystore.folder_of("robot") / KEY_FILE).write_bytes(other)
    assert standings(keystore)["robot"] is Standing.OTHER_KEY
    assert keystore.ensure(NOW) == ("robot",)


def test_an_authority_of_another_key_signs_nothing(keystore: Keystore) -> None:
    other = (keystore.folder_of("imaging") / KEY_FILE).read_bytes()
    (keystore.folder / "authority" / KEY_FILE).write_bytes(other)
    with pytest.raises(ConfigurationError, match="is not the key of the authority's certificate; make a new authority"):
        keystore.issue(("robot",), NOW)


def test_further_names_of_the_router_are_added_and_stay(keystore: Keystore) -> None:
    assert keystore.ensure(NOW, ("or1.local", "10.0.0.7")) == (ROUTER,)
    assert keystore.ensure(NOW, ("or1.local",)) == ()
    keystore.rotate(NOW)
    entry = next(e for e in keystore.entries(NOW) if e.name == ROUTER)
    assert entry.facts is not None
    assert {"localhost", "127.0.0.1", "::1", "router", "or1.local", "10.0.0.7"} == set(entry.facts.host_names)


def test_a_key_that_others_can_read_is_refused(keystore: Keystore) -> None:
    (keystore.folder_of("robot") / KEY_FILE).chmod(0o640)
    with pytest.raises(ConfigurationError, match=r"robot/key.pem can be read by others \(mode 0640, 0600 is needed\)"):
        keystore.ensure(NOW)


def test_an_authority_without_its_key_can_still_be_used_but_makes_nothing(keystore: Keystore) -> None:
    (keystore.folder / "authority" / KEY_FILE).unlink()
    assert keystore.ensure(NOW) == ()
    with pytest.raises(ConfigurationError, match="is missing, so no certificate can be made; put it back"):
        keystore.issue(("robot",), NOW)


def test_nobody_else_gets_a_certificate(keystore: Keystore) -> None:
    with pytest.raises(ConfigurationError, match="nobody is called 'kitchen' here; known are router, imaging"):
        keystore.issue(("robot", "kitchen"), NOW)


def test_a_folder_without_an_authority_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"there is no authority in .*/pki; make one"):
        Keystore(tmp_path / "pki").authority_facts()


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "pki").write_text("a file")
    with pytest.raises(ConfigurationError, match="pki/authority cannot be written"):
        Keystore(tmp_path / "pki").ensure(NOW)

"""A release is verified by programs that know nothing of this project, and every change of it is noticed."""

import json
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import pytest

from shared.pki.signing_key import SigningKey
from tools.npm_lock import console_lock, console_packages
from tools.release import PUBLIC_KEY, SIGNATURE, SUMS, main, sign
from tools.sbom import ROOT, bill_of_materials

MADE_AT = datetime(2026, 1, 2, tzinfo=UTC)
PYPROJECT, LOCK = (ROOT / "pyproject.toml").read_text(), (ROOT / "requirements.lock").read_text()
NPM_LOCK = console_lock()


@pytest.fixture
def signed(tmp_path: Path) -> Path:
    folder = tmp_path / "release"
    folder.mkdir()
    for name in ("distalock.whl", "requirements.lock"):
        (folder / name).write_text(name)
    sign(SigningKey.make(tmp_path / "key.pem"), folder)
    return folder


def verified(folder: Path, public_key: Path | None = None) -> bool:
    """As docs/releases.md says."""
    by = str(public_key or PUBLIC_KEY)
    commands = (
        ["openssl", "pkeyutl", "-verify", "-pubin", "-inkey", by, "-rawin", "-in", SUMS, "-sigfile", SIGNATURE],
        ["sha256sum", "--check", "--strict", "--quiet", SUMS],
    )
    ended = (subprocess.run(words, cwd=folder, capture_output=True, check=False) for words in commands)
    return all(one.returncode == 0 for one in ended)


def test_a_release_is_verified_by_openssl_and_sha256sum(signed: Path) -> None:
    assert verified(signed)


def test_a_changed_file_is_noticed(signed: Path) -> None:
    (signed / "distalock.whl").write_text("changed")
    assert not verified(signed)


def test_changed_sums_are_noticed(signed: Path) -> None:
    sums = (signed / SUMS).read_text()
    (signed / SUMS).write_text(sums.replace(sums[:8], "00000000"))
    assert not verified(signed)


def test_a_release_of_another_key_is_noticed(signed: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.pub"
    other.write_bytes(SigningKey.make(tmp_path / "other.pem").public().pem)
    assert not verified(signed, other)


def test_the_bill_names_what_is_installed_and_who_asks_for_it() -> None:
    bill = json.loads(json.dumps(bill_of_materials(PYPROJECT, LOCK, NPM_LOCK, MADE_AT)))
    components = {component["name"]: component for component in bill["components"]}
    assert {"numpy", "eclipse-zenoh", "cryptography", "starlette"} <= components.keys()
    assert not {"pytest", "mypy", "ruff"} & components.keys()
    of_python = [component for component in components.values() if component["purl"].startswith("pkg:pypi/")]
    for component in of_python:
        assert f"{component['name']}=={component['version']}" in LOCK
        (distribution,) = component["externalReferences"]
        assert distribution["hashes"]
        assert all(f"sha256:{one['content']}" in LOCK for one in distribution["hashes"])
    depends = {entry["ref"]: entry["dependsOn"] for entry in bill["dependencies"]}
    assert components["starlette"]["purl"] in depends[components["fastapi"]["purl"]]
    assert components["numpy"]["purl"] in depends[bill["metadata"]["component"]["bom-ref"]]
    assert depends.keys() == {bill["metadata"]["component"]["bom-ref"], *(c["purl"] for c in components.values())}


def test_the_bill_names_what_the_consoles_page_is_made_of() -> None:
    bill = json.loads(json.dumps(bill_of_materials(PYPROJECT, LOCK, NPM_LOCK, MADE_AT)))
    components = {one["name"]: one for one in bill["components"] if one["purl"].startswith("pkg:npm/")}
    assert {"react", "react-dom", "three", "scheduler", "@tanstack/query-core"} <= components.keys()
    assert not {"vite", "vitest", "jsdom", "@biomejs/biome"} & components.keys()
    assert components["@types/react"]["scope"] == "excluded"
    assert {len(one["hashes"][0]["content"]) for one in components.values()} == {128}
    assert all(one["licenses"][0]["license"]["id"] for one in components.values())
    depends = {entry["ref"]: entry["dependsOn"] for entry in bill["dependencies"]}
    assert (
        components["@tanstack/react-query"]["purl"]
        == f"pkg:npm/%40tanstack/react-query@{components['@tanstack/react-query']['version']}"
    )
    assert components["scheduler"]["purl"] in depends[components["react-dom"]["purl"]]


def test_a_package_without_a_strong_hash_is_refused() -> None:
    lock = json.dumps({"packages": {"node_modules/old": {"version": "1.0.0", "integrity": "sha1-aGVsbG8="}}})
    with pytest.raises(ValueError, match="old: the lock states sha1, sha512 is needed"):
        console_packages(lock)


def test_a_bill_that_is_made_again_is_the_same() -> None:
    assert bill_of_materials(PYPROJECT, LOCK, NPM_LOCK, MADE_AT) == bill_of_materials(
        PYPROJECT, LOCK, NPM_LOCK, MADE_AT
    )


def test_a_key_in_the_checkout_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    key = ROOT / "release.pem"
    assert main(["--key", str(key), "--make-key"]) == 2
    assert not key.exists()
    assert "lies in the checkout" in capsys.readouterr().err


def test_a_folder_that_is_there_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    key = tmp_path / "key.pem"
    assert main(["--key", str(key), "--make-key"]) == 0
    assert key.stat().st_mode & 0o077 == 0
    assert main(["--key", str(key), "--make-key"]) == 2
    assert "cannot be made" in capsys.readouterr().err

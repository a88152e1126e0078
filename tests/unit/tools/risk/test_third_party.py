"""Software of others: all of it is on the page, and an audit says what it found or why it could not look."""

import json
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from shared.errors import InputError
from tools.npm_lock import console_lock, direct_packages
from tools.risk import audit
from tools.risk.files import FOLDER, ThirdParty, entries, load_risk_file
from tools.risk.third_party import direct_names, product_versions, read_audit


def test_every_package_that_the_product_asks_for_is_explained() -> None:
    named = entries(FOLDER / "third-party.yaml", ThirdParty)
    assert {one.name for one in named} == direct_names()
    assert direct_names() <= set(product_versions())
    assert {item for one in named for item in one.items} <= {item.id for item in load_risk_file().items}


def test_every_package_that_the_console_asks_for_is_explained() -> None:
    named = entries(FOLDER / "third-party-console.yaml", ThirdParty)
    assert {one.name for one in named} == direct_packages(console_lock())
    assert {item for one in named for item in one.items} <= {item.id for item in load_risk_file().items}


_SKIPPED = json.dumps({"dependencies": [{"name": "h11", "skip_reason": "not found on PyPI"}], "fixes": []})


def _lock(tmp_path: Path) -> Path:
    lock = tmp_path / "requirements.lock"
    lock.write_text("h11==0.14.0\n")
    return lock


def test_what_is_known_is_listed(tmp_path: Path) -> None:
    known = {"id": "GHSA-1", "fix_versions": ["0.16.0"], "aliases": []}
    packages = [
        {"name": "h11", "version": "0.14.0", "vulns": [known]},
        {"name": "numpy", "version": "2.3.0", "vulns": []},
        {"name": "distalock", "skip_reason": "not on PyPI"},
    ]
    ended = CompletedProcess([], 1, json.dumps({"dependencies": packages, "fixes": []}), "")
    found = audit.audited(_lock(tmp_path), ended)
    assert (found["looked_up"], found["skipped"]) == (2, 1)
    assert found["found"] == [{"name": "h11", "version": "0.14.0", "id": "GHSA-1", "fixed_in": ["0.16.0"]}]
    (tmp_path / "audit.json").write_text(json.dumps(found))
    assert read_audit(tmp_path / "audit.json") == found


@pytest.mark.parametrize(
    ("ended", "why"),
    [
        ("pip-audit is not installed", "pip-audit is not installed"),
        (CompletedProcess([], 1, "", "Traceback\nConnectionError: no route"), "ConnectionError: no route"),
        (CompletedProcess([], 2, "", ""), "ended without a word"),
        (CompletedProcess([], 0, _SKIPPED, "No known vulnerabilities found"), "none of 1 packages was looked up"),
    ],
)
def test_what_could_not_be_looked_up_is_not_taken_for_well(
    tmp_path: Path, ended: str | CompletedProcess[str], why: str
) -> None:
    found = audit.audited(_lock(tmp_path), ended)
    assert why in found["why_not"]
    assert found["looked_up"] == 0


def test_without_a_lock_nothing_is_looked_up(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no lock"):
        audit.main(tmp_path / "requirements.lock", tmp_path / "audit.json")

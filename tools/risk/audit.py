"""`distalock risk audit`: known vulnerabilities of what the lock pins, by pip-audit; says so when it cannot look."""

import hashlib
import json
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from shared.errors import InputError
from tools.risk.evidence import ROOT
from tools.risk.third_party import AUDIT, Audit, Vulnerability

_WITHIN_S: Final = 300.0
_FOUND, _NOT_LOOKED_UP = 1, 3
# What pip-audit ends with when it found something.
_PIP_AUDIT_FOUND: Final = 1
_WITHOUT: Final = "pip-audit is not installed (python -m pip install pip-audit)"


def main(lock: Path = ROOT / "requirements.lock", out: Path = AUDIT) -> int:
    """Look up, write what was found; 1 when there is a known vulnerability, 3 when it cannot be looked up.

    Raises
    ------
    InputError
        When there is no lock.
    """
    if not lock.is_file():
        raise InputError(f"{lock}: there is no lock to look up")
    audit = audited(lock, ask(lock))
    out.write_text(json.dumps(audit, indent=1) + "\n", encoding="utf-8")
    if audit["why_not"]:
        print(f"distalock risk audit: not looked up: {audit['why_not']}", file=sys.stderr)  # noqa: T201 - a command's
        return _NOT_LOOKED_UP
    for one in audit["found"]:
        fixed = ", ".join(one["fixed_in"]) or "no version yet"
        print(f"{one['name']} {one['version']}: {one['id']}, fixed in {fixed}")  # noqa: T201
    counted = f"{audit['looked_up']} packages looked up, {audit['skipped']} could not be"
    print(f"{counted}; {len(audit['found'])} known vulnerabilities")  # noqa: T201
    return _FOUND if audit["found"] else 0


def ask(lock: Path) -> str | subprocess.CompletedProcess[str]:
    """Run pip-audit on the lock; a sentence when it does not run or does not end."""
    words = ["-m", "pip_audit", "--requirement", str(lock), "--no-deps", "--disable-pip", "--format", "json"]
    try:
        ended = subprocess.run(  # noqa: S603 - the interpreter that runs this, and names from this module
            [sys.executable, *words, "--progress-spinner", "off"],
            capture_output=True,
            text=True,
            check=False,
            timeout=_WITHIN_S,
        )
    except subprocess.TimeoutExpired:
        return f"the advisory database did not answer within {_WITHIN_S:g} s"
    return _WITHOUT if "No module named pip_audit" in ended.stderr else ended


def audited(lock: Path, ended: str | subprocess.CompletedProcess[str]) -> Audit:
    """What pip-audit printed, or why it printed nothing."""
    audit: Audit = {
        "at": datetime.now(UTC).date().isoformat(),
        "lock_sha256": hashlib.sha256(lock.read_bytes()).hexdigest(),
        "looked_up": 0,
        "skipped": 0,
        "why_not": "",
        "found": [],
    }
    if isinstance(ended, str):
        return audit | {"why_not": ended}
    if ended.returncode not in (0, _PIP_AUDIT_FOUND) or not ended.stdout.strip():
        last = (ended.stderr.strip().splitlines() or ["pip-audit ended without a word"])[-1]
        return audit | {"why_not": last[:200]}
    listed = json.loads(ended.stdout)["dependencies"]
    packages = [one for one in listed if "skip_reason" not in one]
    if not packages:  # pip-audit calls this "no known vulnerabilities"
        reasons = [str(one["skip_reason"]) for one in listed] or ["it was given no package"]
        return audit | {"why_not": f"none of {len(listed)} packages was looked up; the first: {reasons[0]}"[:200]}
    found: list[Vulnerability] = [
        {"name": one["name"], "version": one["version"], "id": known["id"], "fixed_in": known["fix_versions"]}
        for one in packages
        for known in one["vulns"]
    ]
    return audit | {"looked_up": len(packages), "skipped": len(listed) - len(packages), "found": found}

"""Run Schemathesis as one role, and read what came of it."""

import json
import os
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from services.ui_api.core.roles import PERMISSION_OF, Role, WithoutLogin, may
from tests.fuzz.site import PASSWORD, FuzzSite, account_of

# A stream has no end: what is wrong with a request for one, unit tests ask.
_STREAMS: Final = ("all_events", "case_events")
CHECKS: Final = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
    "unsupported_method",
    "within_role",
)


@dataclass(frozen=True, slots=True)
class RoleRun:
    """What came of the requests of one role.

    Attributes
    ----------
    answers
        How many there were of each status.
    beyond
        Requests that were granted to somebody who may not.
    failed
        Whether Schemathesis found anything; `output` has it.
    """

    role: Role
    answers: Counter[str]
    beyond: tuple[str, ...]
    failed: bool
    output: str

    @property
    def cases(self) -> int:
        """How many requests were answered."""
        return self.answers.total()

    @property
    def server_errors(self) -> int:
        """How many answers were 5xx."""
        return sum(count for status, count in self.answers.items() if status.startswith("5"))


def run_as(role: Role, site: FuzzSite, examples: int, seed: int, folder: Path) -> RoleRun:
    """All phases as one role: examples, coverage, generated requests, and sequences along the links."""
    tally = folder / f"{role}.json"
    context = {
        "url": site.url,
        "name": account_of(role),
        "password": PASSWORD,
        "actions": [
            str(action)
            for action, it in PERMISSION_OF.items()
            if may(frozenset({role}), action) or it.without_login is not WithoutLogin.NOBODY
        ],
        "known": site.known,
        "plan_etag": site.plan_etag,
        "seed": seed,
        "tally": str(tally),
    }
    words = [
        sys.executable,
        "-m",
        "schemathesis.cli",
        "run",
        f"{site.url}/openapi.json",
        "--phases",
        "examples,coverage,fuzzing,stateful",
    ]
    words += ["--checks", ",".join(CHECKS), "--max-examples", str(examples), "--seed", str(seed), "--workers", "1"]
    words += [
        "--continue-on-failure",
        "--no-shrink",
        "--generation-database",
        "none",
        "--suppress-health-check",
        "all",
        "--warnings",
        "off",
    ]
    words += ["--request-timeout", "60", "--no-color"]
    for name in _STREAMS:
        words += ["--exclude-operation-id", name]
    environment = {**os.environ, "SCHEMATHESIS_HOOKS": "tests.fuzz.hooks", "DISTALOCK_FUZZ": json.dumps(context)}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    found = json.loads(tally.read_text(encoding="utf-8")) if tally.exists() else {"answers": {}, "beyond": []}
    output = done.stdout + done.stderr
    return RoleRun(role, Counter(found["answers"]), tuple(found["beyond"]), done.returncode != 0, output)

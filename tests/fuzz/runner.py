"""Run Schemathesis as one role, and read what came of it."""

import json
import os
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from services.ui_api.core.roles import PERMISSION_OF, Role, WithoutLogin, may
from tests.fuzz.site import OTHER_ACCOUNT, PASSWORD, FuzzSite, account_of

# A stream has no end: what is wrong with a request for one, unit tests ask.
STREAMS: Final = ("all_events", "case_events")
CHECKS: Final = (
    "no_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
    "unsupported_method",
    "within_role",
)

ALL_PHASES: Final = ("examples", "coverage", "fuzzing", "stateful")


@dataclass(frozen=True, slots=True)
class FuzzPlan:
    """How much is asked.

    Attributes
    ----------
    examples
        Of each operation in the phase of generated requests, and so many sequences.
    seconds
        As each role, at most: generated requests and sequences are repeated until then; None for once.
    """

    examples: int
    seed: int
    phases: tuple[str, ...] = ALL_PHASES
    seconds: int | None = None


@dataclass(frozen=True, slots=True)
class RoleRun:
    """What came of the requests of one role.

    Attributes
    ----------
    answers
        How many there were of each status.
    phases
        How many requests there were of each phase.
    beyond
        Requests that were granted to somebody who may not.
    not_ready
        Answers of `/readyz` that name a part which is not ready.
    links, links_that_succeeded
        How often each link was followed, and how often to an answer below 400.
    inferred
        Steps along links that the document does not have, and Schemathesis infers from names.
    sequences, longest
        Sequences along links, and the most links in one of them.
    failed
        Whether Schemathesis found anything; `output` has it.
    """

    role: Role
    answers: Counter[str]
    phases: Counter[str]
    beyond: tuple[str, ...]
    not_ready: int
    links: Counter[str]
    links_that_succeeded: Counter[str]
    inferred: int
    sequences: int
    longest: int
    took_s: float
    failed: bool
    output: str

    @property
    def cases(self) -> int:
        """How many requests were answered."""
        return self.answers.total()

    @property
    def server_errors(self) -> int:
        """How many answers were 5xx; those of `/readyz` that say which part is not ready are none."""
        return sum(count for status, count in self.answers.items() if status.startswith("5")) - self.not_ready


_RUN: Final = ".run.json"
_RUNS: Final = TypeAdapter(RoleRun)


def run_as(role: Role, site: FuzzSite, plan: FuzzPlan, folder: Path) -> RoleRun:
    """All phases as one role: examples, coverage, generated requests, and sequences along the links."""
    tally, began_s = folder / f"{role}.json", time.monotonic()
    environment = {
        **os.environ,
        "SCHEMATHESIS_HOOKS": "tests.fuzz.hooks",
        "DISTALOCK_FUZZ": json.dumps(_context(role, site, plan.seed, tally)),
    }
    done = subprocess.run(_words(site.url, plan), env=environment, capture_output=True, text=True, check=False)
    found = json.loads(tally.read_text(encoding="utf-8"))
    return RoleRun(
        role=role,
        answers=Counter(found["answers"]),
        phases=Counter(found["phases"]),
        beyond=tuple(found["beyond"]),
        not_ready=found["not_ready"],
        links=Counter(found["links"]),
        links_that_succeeded=Counter(found["links_that_succeeded"]),
        inferred=found["inferred"],
        sequences=found["sequences"],
        longest=found["longest"],
        took_s=time.monotonic() - began_s,
        failed=done.returncode != 0,
        output=done.stdout + done.stderr,
    )


def write_run(run: RoleRun, folder: Path) -> None:
    """Keep a run, and what Schemathesis said."""
    (folder / f"{run.role}{_RUN}").write_bytes(_RUNS.dump_json(run))
    (folder / f"{run.role}.txt").write_text(run.output, encoding="utf-8")


def kept_runs(folder: Path) -> list[RoleRun]:
    """Runs that were kept, in the order of the roles."""
    files = [folder / f"{role}{_RUN}" for role in Role]
    return [_RUNS.validate_json(file.read_bytes()) for file in files if file.exists()]


def _context(role: Role, site: FuzzSite, seed: int, tally: Path) -> dict[str, object]:
    """What the hooks know: who asks, what he may, and what there is."""
    actions = [
        str(action)
        for action, it in PERMISSION_OF.items()
        if may(frozenset({role}), action) or it.without_login is not WithoutLogin.NOBODY
    ]
    there_is = site.fresh_case()
    return {
        "url": site.url,
        "name": account_of(role),
        "roles": [role.value],
        "password": PASSWORD,
        "administrator": site.administrator,
        "actions": actions,
        "known": dict(there_is.known),
        "known_user": OTHER_ACCOUNT,
        "plan_etag": there_is.plan_etag,
        "bodies": _good_bodies(account_of(role), str(there_is.known["image_id"])),
        "seed": seed,
        "tally": str(tally),
    }


def _good_bodies(name: str, image: str) -> dict[str, object]:
    """By operation, what is granted as long as the state of things allows it."""
    plan, guide = {"localisation": 1, "hole_ids": ["distal"]}, {"images": [image], "of": "guide"}
    return {
        "sign_in": {"name": name, "password": PASSWORD},
        "create_user": {"password": PASSWORD, "roles": ["viewer"]},
        "change_case": {"drill_diameter_mm": 4.2, "why": "as on the drill"},
        "record_step": {"step": "wires_removed", "why": "once more"},
        "make_plan": plan,
        "approve_plan": {"password": PASSWORD},
        "begin_motion": {"plan": 1},
        "make_verification": guide,
        "make_qa_report": {"images": [image]},
        "begin_computation": {"verification": guide},
    }


def _words(url: str, plan: FuzzPlan) -> list[str]:
    words = [sys.executable, "-m", "schemathesis.cli", "run", f"{url}/openapi.json", "--phases", ",".join(plan.phases)]
    words += ["--checks", ",".join(CHECKS), "--max-examples", str(plan.examples), "--seed", str(plan.seed)]
    words += ["--workers", "1", "--continue-on-failure", "--no-shrink", "--generation-database", "none"]
    words += ["--suppress-health-check", "all", "--warnings", "off", "--request-timeout", "60", "--no-color"]
    words += [] if plan.seconds is None else ["--max-time", str(plan.seconds)]
    for name in STREAMS:
        words += ["--exclude-operation-id", name]
    return words

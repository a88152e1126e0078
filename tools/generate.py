"""Write every generated file, or check that all are up to date: message schemas, `openapi.json`, tables of the docs,
the client's modules, numbers for the console's tests.

usage: python -m tools.generate [--check]
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from services.ui_api.app import openapi_document, routed_app
from shared.messages.schema_files import SCHEMAS, schema_texts
from tools.asyncapi import asyncapi_text
from tools.client.generate import client_files
from tools.console_fixture import FIXTURE, fixture_text
from tools.decisions_page import decisions_page
from tools.keys_page import keys_page
from tools.monitoring import alert_rules, dashboard, monitoring_page
from tools.part_schemas import part_schema_texts
from tools.procedure_page import procedure_page
from tools.refusals_page import refusals_page
from tools.rest_page import rest_page
from tools.risk.alarms_page import alarms_page
from tools.risk.fmea import fmea_page
from tools.risk.pages import hazards_page, requirements_page, software_page, use_errors_page
from tools.risk.third_party import third_party_page
from tools.settings_page import settings_page
from tools.simulator_page import simulator_page
from tools.tuning_page import tuning_page

_DOCS = Path(__file__).parents[1] / "docs"
_PART_SCHEMAS = _DOCS / "schemas"
_MONITORING = _DOCS.parent / "deploy" / "monitoring"
_PAGES: dict[str, Callable[[], str]] = {
    "openapi.json": lambda: json.dumps(openapi_document(routed_app()), indent=1, ensure_ascii=False) + "\n",
    "asyncapi.json": asyncapi_text,
    "decisions/README.md": decisions_page,
    "keys.md": keys_page,
    "monitoring.md": monitoring_page,
    "procedure.md": procedure_page,
    "refusals.md": refusals_page,
    "rest.md": rest_page,
    "risk/alarms.md": alarms_page,
    "risk/fmea.md": fmea_page,
    "risk/hazards.md": hazards_page,
    "risk/requirements.md": requirements_page,
    "risk/software.md": software_page,
    "risk/third-party.md": third_party_page,
    "risk/use-errors.md": use_errors_page,
    "settings.md": settings_page,
    "simulator-api.md": simulator_page,
    "tuning.md": tuning_page,
}


def generated_files() -> dict[Path, str]:
    """Path and content of every generated file."""
    schemas = {SCHEMAS / name: text for name, text in schema_texts().items()}
    schemas |= {_PART_SCHEMAS / name: text for name, text in part_schema_texts().items()}
    schemas |= {_MONITORING / "alerts.json": alert_rules(), _MONITORING / "dashboard.json": dashboard()}
    schemas |= client_files()
    schemas |= {FIXTURE: fixture_text()}
    return schemas | {_DOCS / name: text() for name, text in _PAGES.items()}


def differences() -> list[str]:
    """What is wrong with the committed files, one sentence each; empty when nothing is."""
    wanted = generated_files()
    unknown = sorted(
        file for folder in (SCHEMAS, _PART_SCHEMAS) for file in folder.glob("*.json") if file not in wanted
    )
    outdated = [file for file, text in wanted.items() if not file.exists() or file.read_text(encoding="utf-8") != text]
    return [
        *(f"{file.name} is missing or out of date" for file in sorted(outdated)),
        *(f"{file.name} belongs to no message and no part; delete it" for file in unknown),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check; 1 when a check fails."""
    parser = argparse.ArgumentParser(prog="python -m tools.generate", description="write all generated files")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    if not parser.parse_args(arguments).check:
        for folder in (SCHEMAS, _PART_SCHEMAS):
            folder.mkdir(exist_ok=True)
        for file, text in generated_files().items():
            file.write_text(text, encoding="utf-8")
        return 0
    found = differences()
    for sentence in found:
        print(f"{sentence}; run make generated and commit", file=sys.stderr)  # noqa: T201 - a command's output
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

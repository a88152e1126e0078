"""`distalock doctor`: looks, prints a table with remedies, changes nothing."""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Final

from rich.console import Console
from rich.table import Table

from distalock.doctor.running import controller_finding, dicom_finding, gateway_findings, ports_finding
from distalock.doctor.settings import settings_finding
from distalock.installation import Installation, Ports
from services.imaging.settings import ImagingSettings
from services.robot.settings import RobotSettings
from shared.doctor.finding import Finding, Verdict
from shared.doctor.machine import Machine, disk_finding, machine_findings
from shared.doctor.state import state_findings
from shared.runtime.settings import ServiceSettings, load_settings

EXIT_WELL, EXIT_WRONG, EXIT_ATTENTION = 0, 1, 3
_STYLES: Final = {Verdict.WELL: "green", Verdict.ATTENTION: "yellow", Verdict.WRONG: "bold red", Verdict.UNKNOWN: "dim"}


def run(given: argparse.Namespace) -> int:
    """Exit code: 1 when something is wrong, 3 when something needs attention, else 0."""
    findings = list(_findings(given))
    if given.json:
        print(json.dumps([asdict(finding) for finding in findings], indent=1, ensure_ascii=False))
    else:
        Console(soft_wrap=False).print(table_of(findings))
    return exit_code(findings)


def exit_code(findings: Sequence[Finding]) -> int:
    """As `run` says."""
    verdicts = {finding.verdict for finding in findings}
    if Verdict.WRONG in verdicts:
        return EXIT_WRONG
    return EXIT_ATTENTION if Verdict.ATTENTION in verdicts else EXIT_WELL


def table_of(findings: Sequence[Finding]) -> Table:
    """One row a finding: what was looked at, how it stands, what was measured, and the remedy below it."""
    table = Table(box=None, pad_edge=False)
    for heading in ("", "", "measured, and what to do"):
        table.add_column(heading, overflow="fold")
    for finding in findings:
        style = _STYLES[finding.verdict]
        said = finding.measured + (f"\n→ {finding.remedy}" if finding.remedy else "")
        table.add_row(finding.name, f"[{style}]{finding.verdict}[/{style}]", said)
    return table


def _findings(given: argparse.Namespace) -> Iterator[Finding]:
    yield from machine_findings(Machine.read(given.state))
    settings = settings_finding()
    yield settings
    if settings.verdict is Verdict.WRONG:
        return  # what follows would be looked for in places that nobody meant
    yield disk_finding(given.state, load_settings(ServiceSettings, state_dir=given.state))
    yield from state_findings(given.state, datetime.now(UTC))
    ports = Ports(router=given.router_port, rest=given.rest_port, dicom=given.dicom_port)
    gateway = Installation(ports, given.state.resolve(), given.controller, https=given.https).gateway
    running = gateway.answer("/healthz") is not None
    yield ports_finding({"router": ports.router, "REST": ports.rest, "DICOM": ports.dicom}, running=running)
    imaging = load_settings(ImagingSettings, dicom_port=given.dicom_port)
    yield dicom_finding(imaging, running=running)
    yield controller_finding(given.controller, load_settings(RobotSettings), running=running)
    yield from gateway_findings(gateway)

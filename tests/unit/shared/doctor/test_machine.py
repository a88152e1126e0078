"""What the doctor says of a machine, from what was read of it."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from shared.bus.shared_memory import MemoryLimits
from shared.doctor.finding import Verdict
from shared.doctor.machine import Machine, disk_finding, machine_findings
from shared.runtime.settings import ServiceSettings

GOOD = Machine(
    processors=4,
    memory_mib=16_000.0,
    handles=65_536,
    locked=MemoryLimits(None, 2**30),
    real_time=True,
    synchronised=True,
    now_s=1000.0,
    newest_file_s=990.0,
)


def test_a_good_machine_is_well() -> None:
    findings = list(machine_findings(GOOD))
    assert {finding.verdict for finding in findings} == {Verdict.WELL}
    assert all(finding.measured and not finding.remedy for finding in findings)


@pytest.mark.parametrize(
    ("change", "name", "verdict", "remedy"),
    [
        ({"processors": 1}, "processors", Verdict.ATTENTION, "two"),
        ({"memory_mib": 1024.0}, "memory", Verdict.ATTENTION, "add memory"),
        ({"handles": 1024}, "handles", Verdict.ATTENTION, "LimitNOFILE"),
        ({"locked": MemoryLimits(2**16, 2**30)}, "shared memory", Verdict.ATTENTION, "LimitMEMLOCK"),
        ({"real_time": False}, "real time", Verdict.ATTENTION, "rtprio"),
        ({"synchronised": False}, "clock", Verdict.ATTENTION, "chrony"),
        ({"synchronised": None}, "clock", Verdict.UNKNOWN, ""),
        ({"newest_file_s": 4600.0}, "clock", Verdict.WRONG, "set back"),
    ],
)
def test_each_lack_has_its_remedy(change: Mapping[str, object], name: str, verdict: Verdict, remedy: str) -> None:
    findings = list(machine_findings(replace(GOOD, **change)))  # type: ignore[arg-type]  # one field each
    (found,) = [finding for finding in findings if finding.verdict is not Verdict.WELL]
    assert (found.name, found.verdict) == (name, verdict)
    assert remedy in found.remedy


def test_this_machine_can_be_read(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    machine = Machine.read(tmp_path)
    assert machine.processors >= 1
    assert machine.memory_mib > 100.0
    assert abs((machine.newest_file_s or 0.0) - machine.now_s) < 60.0


def test_a_disk_below_the_services_limit_needs_attention(tmp_path: Path) -> None:
    not_there_yet = tmp_path / "state" / "deep"
    assert disk_finding(not_there_yet, ServiceSettings(announce_free_percent=0.0)).verdict is Verdict.WELL
    full = disk_finding(not_there_yet, ServiceSettings(least_free_mib=1e9))
    assert full.verdict is Verdict.ATTENTION
    assert full.remedy

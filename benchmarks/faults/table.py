"""The faults, one row each. `docs/faults.md` shows what came of them."""

from typing import Final

from benchmarks.faults.declaration import Answers, Fault, InMotion, Readiness
from benchmarks.faults.outside_faults import clock_stepped, controller_silent, image_storm, line_cut, ports_probed
from benchmarks.faults.process_faults import hung, killed, restarted, without_handles, without_memory
from benchmarks.faults.site import CHILDREN, PROCESSES
from benchmarks.faults.storage_faults import disk_full, disk_read_only, record_corrupt, record_full, record_locked

_HOUR_S: Final = 3600.0
_SECONDS: Final = 3.0
# Who answers requests: while it is gone, nobody does.
_GATEWAY: Final = frozenset({"ui_api", "application"})
_GUARDIAN: Final = "guardian"
_ALL: Final = (*PROCESSES, *CHILDREN)


def _answers(name: str) -> Answers:
    return Answers.SILENT if name in _GATEWAY else Answers.REFUSES


def _ended_with(name: str) -> frozenset[str]:
    """Who ends when a process ends: itself, and who has started it; the guardian is started again."""
    parent = CHILDREN[name][0] if name in CHILDREN else name
    return frozenset() if name == _GUARDIAN else frozenset({name, parent})


def _gone(name: str) -> tuple[Fault, Fault]:
    """Killed and hung. The robot service notices a guardian that is lost, and starts another one at once."""
    readiness = Readiness.ANY if name == _GUARDIAN else Readiness.NEVER
    return (
        Fault(f"{name} killed", killed(name), readiness, InMotion.STOPS, _answers(name), _ended_with(name)),
        Fault(f"{name} stopped", hung(name), readiness, InMotion.STOPS, _answers(name)),
    )


def _restarted(name: str) -> Fault:
    return Fault(f"{name} restarted", restarted(name), Readiness.ANY, InMotion.STOPS, _answers(name))


def _exhausted(name: str) -> tuple[Fault, ...]:
    """A router that takes nobody new goes on for those that it has: what `readyz` stands for is not broken."""
    readiness = Readiness.ANY if name == "router" else Readiness.NEVER
    return tuple(
        Fault(f"{name} without {what}", inject(name), readiness, answers=_answers(name), may_end=_ended_with(name))
        for what, inject in (("handles", without_handles), ("memory", without_memory))
    )


FAULTS: Final = (
    *(fault for name in _ALL for fault in _gone(name)),
    *(_restarted(name) for name in PROCESSES),
    *(fault for name in _ALL if name != _GUARDIAN for fault in _exhausted(name)),
    Fault("record locked", record_locked, Readiness.NEVER),
    Fault("record's disk full", record_full, Readiness.NEVER, needs_mounts=True),
    Fault("record corrupt", record_corrupt, Readiness.NEVER),
    Fault("disk full", disk_full, Readiness.NEVER, needs_mounts=True),
    Fault("disk read-only", disk_read_only, Readiness.NEVER, needs_mounts=True),
    Fault("controller silent", controller_silent(), Readiness.NEVER, InMotion.UNREACHABLE),
    Fault("line cut", line_cut, Readiness.NEVER, InMotion.UNREACHABLE),
    Fault("clock 3 s ahead", clock_stepped(_SECONDS), answers=Answers.GOES_ON, held_s=2.0),
    Fault("clock 3 s back", clock_stepped(-_SECONDS), answers=Answers.GOES_ON, held_s=2.0),
    Fault("clock 1 h ahead", clock_stepped(_HOUR_S), answers=Answers.GOES_ON, held_s=2.0),
    Fault("clock 1 h back", clock_stepped(-_HOUR_S), answers=Answers.GOES_ON, held_s=2.0),
    Fault("ports probed", ports_probed, answers=Answers.GOES_ON, held_s=3.0),
    Fault("image storm", image_storm, held_s=2.0),
)

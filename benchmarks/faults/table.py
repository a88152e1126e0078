"""The faults, one row each. `docs/faults.md` shows what came of them."""

from typing import Final

from benchmarks.faults.declaration import Answers, Fault, InMotion, Readiness
from benchmarks.faults.outside_faults import clock_stepped, controller_silent, image_storm, line_cut, ports_probed
from benchmarks.faults.process_faults import hung, killed, restarted, without_handles, without_memory
from benchmarks.faults.site import CHILDREN, PROCESSES
from benchmarks.faults.storage_faults import disk_full, disk_read_only, record_corrupt, record_full, record_locked

_HOUR_S: Final = 3600.0
_SECONDS: Final = 3.0
# Whoever asks these, or asks through them, gets no answer while they are gone.
_BETWEEN: Final = frozenset({"router", "ui_api"})
# What has to be there to move, or to stop.
_MOVING: Final = frozenset({"router", "robot", "ui_api", *CHILDREN})


def _answers(name: str) -> Answers:
    return Answers.SILENT if name in _BETWEEN else Answers.REFUSES


def _in_motion(name: str) -> InMotion:
    return InMotion.STOPS if name in _MOVING else InMotion.MAY_FINISH


def _readiness_when_exhausted(name: str) -> Readiness:
    """A router that takes nobody new goes on for those that it has: what `readyz` stands for is not broken."""
    return Readiness.ANY if name == "router" else Readiness.NEVER


def _processes() -> tuple[Fault, ...]:
    gone = [
        Fault(f"{name} killed", killed(name), Readiness.NEVER, _in_motion(name), _answers(name)) for name in PROCESSES
    ]
    hanging = [
        Fault(f"{name} stopped", hung(name), Readiness.NEVER, _in_motion(name), _answers(name)) for name in PROCESSES
    ]
    back = [
        Fault(f"{name} restarted", restarted(name), Readiness.ANY, _in_motion(name), _answers(name))
        for name in PROCESSES
    ]
    watched = [
        Fault(f"{name} {what}", inject(name), Readiness.ANY, _in_motion(name), held_s=2.0)
        for name in CHILDREN
        for what, inject in (("killed", killed), ("stopped", hung))
    ]
    return (*gone, *hanging, *back, *watched)


def _exhausted() -> tuple[Fault, ...]:
    handles = [
        Fault(
            f"{name} without handles",
            without_handles(name),
            _readiness_when_exhausted(name),
            answers=_answers(name),
            may_end=frozenset({name}),
        )
        for name in PROCESSES
    ]
    memory = [
        Fault(
            f"{name} without memory",
            without_memory(name),
            _readiness_when_exhausted(name),
            answers=_answers(name),
            may_end=frozenset({name}),
        )
        for name in PROCESSES
    ]
    return (*handles, *memory)


_STORAGE: Final = (
    Fault("record locked", record_locked, Readiness.NEVER),
    Fault("record's disk full", record_full, Readiness.NEVER, needs_mounts=True),
    Fault("record corrupt", record_corrupt, Readiness.NEVER),
    Fault("disk full", disk_full, Readiness.NEVER, needs_mounts=True),
    Fault("disk read-only", disk_read_only, Readiness.NEVER, needs_mounts=True),
)

_OUTSIDE: Final = (
    Fault("controller silent", controller_silent(), Readiness.NEVER, InMotion.UNREACHABLE),
    Fault("line cut", line_cut, Readiness.NEVER, InMotion.UNREACHABLE),
    Fault("clock 3 s ahead", clock_stepped(_SECONDS), answers=Answers.GOES_ON, held_s=2.0),
    Fault("clock 3 s back", clock_stepped(-_SECONDS), answers=Answers.GOES_ON, held_s=2.0),
    Fault("clock 1 h ahead", clock_stepped(_HOUR_S), answers=Answers.GOES_ON, held_s=2.0),
    Fault("clock 1 h back", clock_stepped(-_HOUR_S), answers=Answers.GOES_ON, held_s=2.0),
    Fault("ports probed", ports_probed, answers=Answers.GOES_ON, held_s=3.0),
    Fault("image storm", image_storm, held_s=2.0),
)

FAULTS: Final = (*_processes(), *_exhausted(), *_STORAGE, *_OUTSIDE)

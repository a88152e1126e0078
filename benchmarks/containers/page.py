"""The page of figures of containers. Pure."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from benchmarks.containers.faults import LASTS_S, READY_WITHIN_S, ContainerFinding
from benchmarks.containers.figures import ImageTimes
from benchmarks.faults.declaration import SAFE_WITHIN_MM, SAFE_WITHIN_S

# MB above the base layer.
LIMITS_MB: Final[Mapping[str, float]] = {
    "router": 30.0,
    "robot": 150.0,
    "ui_api": 250.0,
    "registration": 350.0,
    "imaging": 350.0,
}
MOST_TIMES: Final = 1.5
_SHARED, _TCP = "shared_memory", "tcp"
# The first of a sender may come by TCP.
_MOST_BY_TCP: Final = 1


def page(
    made_of: str,
    sizes_mb: Mapping[str, float],
    times: ImageTimes,
    paths: Mapping[str, int],
    memory_mib: Mapping[str, float],
    findings: Sequence[ContainerFinding],
) -> tuple[str, bool]:
    """Text of the page, and whether every limit held."""
    lines = ["# Containers", "", f"`distalock bench containers`, {made_of}.", ""]
    lines += ["| image | MB above the base | limit |", "|---|---|---|"]
    for image, size_mb in sizes_mb.items():
        limit = LIMITS_MB.get(image)
        lines.append(f"| {image} | {size_mb:.0f} | {'' if limit is None else f'{limit:.0f}'} |")
    shared, tcp = paths.get(_SHARED, 0), paths.get(_TCP, 0)
    lines += [
        "",
        "| | measured | limit |",
        "|---|---|---|",
        f"| first image in fresh containers, s | {times.first_s:.2f} | |",
        f"| second image, s | {times.second_s:.2f} | |",
        f"| first over second | {times.ratio:.2f} | {MOST_TIMES} |",
        f"| frames by shared memory | {shared} of {shared + tcp} | all but the first |",
        *(f"| resident memory of {name}, MiB | {mib:.0f} | |" for name, mib in memory_mib.items()),
    ]
    lines += [*_faults(findings), ""]
    held = (
        all(sizes_mb[image] <= limit for image, limit in LIMITS_MB.items())
        and times.ratio <= MOST_TIMES
        and tcp <= _MOST_BY_TCP
        and not any(finding.wrong for finding in findings)
    )
    return "\n".join(lines), held


def _faults(findings: Sequence[ContainerFinding]) -> Iterator[str]:
    if not findings:
        return
    survived = sum(not finding.wrong for finding in findings)
    what_holds = (
        f"{survived} of {len(findings)} survived: in motion at rest and locked within {SAFE_WITHIN_S} s and "
        f"{SAFE_WITHIN_MM} mm, ready again by themselves within {READY_WITHIN_S:g} s, nothing lost that was "
        "acknowledged. While the robot's network is gone, a controller on the network cannot be reached: the motion "
        "ends at its target, held by its servo."
    )
    yield from (
        "",
        f"## Killed, paused and cut off for {LASTS_S:g} s",
        "",
        what_holds,
        "",
        "| container | step | at rest and locked, s | way, mm | ready, s | what did not hold |",
        "|---|---|---|---|---|---|",
    )
    for finding in findings:
        safe = "never" if finding.safe_s is None else f"{finding.safe_s:.2f}"
        cells = (
            finding.fault,
            finding.step,
            safe,
            f"{finding.travel_mm:.2f}",
            f"{finding.ready_s:.1f}",
            "; ".join(finding.wrong),
        )
        yield f"| {' | '.join(cells)} |"

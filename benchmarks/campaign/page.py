"""The campaign's page: how procedures ended, by what went wrong, and what noticed it."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final

from benchmarks.campaign.harm import MOST_ANGLE_DEG, MOST_ENTRY_MM
from benchmarks.campaign.rows import CaseRow, Ending, Moment
from benchmarks.common.statistics import quantiles, text_of

# Upper bound of a probability of which nothing was seen in n trials, at 95 %: the rule of three.
_RULE_OF_THREE: Final = 3.0
_MOST_CODES: Final = 4
_WHOLE: Final = 1000


def page(rows: Sequence[CaseRow], first_seed: int) -> str:
    """The page."""
    return "\n".join(
        [
            "# Campaign: procedures in which something goes wrong",
            "",
            _about(rows, first_seed),
            "",
            "## Endings",
            "",
            *_endings(rows),
            "",
            *_harms(rows),
            "",
            "## What people did wrong",
            "",
            *_by(rows, "error", lambda row: row.error or "nothing"),
            "",
            "## What was wrong with the images",
            "",
            *_by(rows, "images", lambda row: row.image or "nothing"),
            "",
            "## What failed in the hardware",
            "",
            *_by(rows, "fault", lambda row: row.fault or "nothing"),
            "",
            "## Where it was noticed",
            "",
            *_by_moment(rows),
            "",
            "## Why procedures ended without drilled holes",
            "",
            *_reasons(rows),
            "",
        ]
    )


def _about(rows: Sequence[CaseRow], first_seed: int) -> str:
    count = len(rows)
    cut = "" if count >= _WHOLE else f" **A whole run plays {_WHOLE:,}; this one was cut off: it shows little.**"
    seconds = text_of(quantiles(row.took_s for row in rows), 1)
    return (
        f"Made by `distalock bench campaign`: {count} seeded procedures from seed {first_seed}, with random patients, "
        "nails and C-arms. Six in ten have an error of people, three in ten a fault of the hardware, and images of "
        "half of them something that the model does not know. The services run in one process on one bus, in time "
        "that passes only when told to: robot service, guard and driver down to the bytes of the virtual controller, "
        "registration and the gateway's handlers with their own messages, imaging's calibration. Left out: DICOM, "
        "HTTP, users, TLS, threads and processes, which have tests of their own ([testing](../testing.md)), live "
        "guidance, and K-wires: the guide itself is verified. People who heed a refusal (seven in ten) mend what it "
        "names; the others go on where the system lets them. What counts as harm is defined in "
        "`benchmarks/campaign/harm.py`, and judged by the virtual room's truth alone. Processor time of one "
        f"procedure: {seconds} s (median / 95 % / worst), the compilation of kernels in the first included.{cut}"
    )


def _endings(rows: Sequence[CaseRow]) -> Iterator[str]:
    yield "| ending | procedures | share |"
    yield "|---|---|---|"
    for ending in Ending:
        count = sum(row.ending is ending for row in rows)
        yield f"| {ending} | {count} | {100.0 * count / max(len(rows), 1):.1f} % |"
    holes = [hole for row in rows for hole in row.holes if hole.allowed and not hole.slipped]
    yield ""
    yield (
        "*Crashed*: ended by an error in a program, which is a bug with a seed. "
        f"*Against advice*: somebody drilled although the system said that it is not time. Of {len(holes)} holes that "
        "the system allowed to drill, the guide's true axis was off by "
        f"{text_of(quantiles(hole.entry_mm for hole in holes), 2)} mm at the entry and "
        f"{text_of(quantiles(hole.angle_deg for hole in holes), 2)}° (median / 95 % / worst; limits "
        f"{MOST_ENTRY_MM:g} mm and {MOST_ANGLE_DEG:g}°); {sum(hole.passed for hole in holes)} drills passed."
    )
    slipped = [hole for row in rows for hole in row.holes if hole.allowed and hole.slipped]
    off = sum(hole.entry_mm > MOST_ENTRY_MM or hole.angle_deg > MOST_ANGLE_DEG for hole in slipped)
    yield (
        f"After the system's last image the mount slipped before {len(slipped)} holes, {off} of which were drilled "
        "beyond the limits: nothing sees that, and it is no harm by the system ([hazard H05](../risk/hazards.md#h05))."
    )


def _harms(rows: Sequence[CaseRow]) -> Iterator[str]:
    harmed = [row for row in rows if row.harms]
    if not harmed:
        bound = _RULE_OF_THREE / max(len(rows), 1)
        yield f"No harm: at 95 % its probability in such a procedure is below {100.0 * bound:.1f} %."
        return
    yield "Every harm is a bug with a seed: `distalock bench campaign --count 1 --seed SEED` plays it again."
    yield ""
    yield "| seed | error | images | fault | harm |"
    yield "|---|---|---|---|---|"
    for row in harmed:
        yield f"| {row.seed} | {row.error} | {row.image} | {row.fault} | {'; '.join(row.harms)} |"


def _by(rows: Sequence[CaseRow], name: str, of: Callable[[CaseRow], str]) -> Iterator[str]:
    heads = " | ".join(Ending)
    yield f"| {name} | procedures | {heads} | noticed in | first noticed by |"
    yield "|---|" + "---|" * (len(Ending) + 3)
    for what in sorted({of(row) for row in rows}):
        mine = [row for row in rows if of(row) == what]
        counts = " | ".join(str(sum(row.ending is ending for row in mine)) for ending in Ending)
        noticed = sum(bool(row.noticed) for row in mine)
        codes = _codes(row.noticed[0].code for row in mine if row.noticed)
        yield f"| {what} | {len(mine)} | {counts} | {noticed} | {codes} |"


def _by_moment(rows: Sequence[CaseRow]) -> Iterator[str]:
    yield "| step | refusals and stops | in procedures | codes |"
    yield "|---|---|---|---|"
    for moment in Moment:
        noticed = [one for row in rows for one in row.noticed if one.moment is moment]
        procedures = sum(any(one.moment is moment for one in row.noticed) for row in rows)
        yield f"| {moment} | {len(noticed)} | {procedures} | {_codes(one.code for one in noticed)} |"


def _reasons(rows: Sequence[CaseRow]) -> Iterator[str]:
    ended = [row for row in rows if row.ending in (Ending.REFUSED, Ending.STOPPED, Ending.CRASHED)]
    yield "One of each code, as the surgeon reads it."
    yield ""
    yield "| ended by | procedures | for instance |"
    yield "|---|---|---|"
    counts = Counter(row.why.partition(":")[0] for row in ended)
    for code, count in counts.most_common():
        example = next(row for row in ended if row.why.partition(":")[0] == code)
        yield f"| `{code}` | {count} | {example.why.partition(':')[2].strip()} (seed {example.seed}) |"


def _codes(codes: Iterable[str]) -> str:
    counted = Counter(codes).most_common(_MOST_CODES)
    return ", ".join(f"`{code}` {count}" for code, count in counted) or "-"

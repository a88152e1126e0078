"""The page of the races. Pure, but for the load of the machine."""

from collections import Counter
from collections.abc import Sequence
from statistics import median
from typing import Final

from benchmarks.gateway.race_rows import RaceRow

_MOST_SHOWN: Final = 20
_FROM: Final = {"stand_in": "offered", "images": "from images"}
_PAGE: Final = """# Two surgeons at once

Made by `distalock bench races` (seed {seed}): real router, gateway and robot service, two surgeons with accounts and
sessions of their own, seeded scripts of approving, moving, taking back and stopping against one plan at the same time,
some requests twice under one key. In most races the benchmark stands in for registration and offers a plan to
somewhere near, because none of those who race waits for registration, and an image with its localisation takes longer
than a race. In the others, plans are of images taken in the virtual operating room, one image for all races until the
robot has moved. Motions take about half a second, pauses up to 0.15 s.

| plans | races | requests | motions | races with a stop | median duration | faults |
|---|---|---|---|---|---|---|
{kinds}
A fault is one of these:
- a second motion to the controller from one plan, or one that no operation says to have begun;
- a motion to the controller after a stop's byte; a robot that moves, or has no stop in force, after a stop was answered
  200; a stop that was answered otherwise;
- a repeat under the same key that gets another answer;
- a refusal other than 409 and 412, without a reason, or with a code that is on no page;
- a motion on record without an approval in force; an answer of success without its event, or the other way round;
- a chain that does not verify.

| request | answer | code | times |
|---|---|---|---|
{answers}
## Faults

{faults}"""


def page_of(rows: Sequence[RaceRow], seed: int) -> str:
    """The page."""
    counts = Counter((one.action, one.status, one.code) for row in rows for one in row.answers)
    answers = "".join(
        f"| {action} | {status} | {f'`{code}`' if code else ''} | {count} |\n"
        for (action, status, code), count in sorted(counts.items())
    )
    found = [f"- race {row.number}: {fault}\n" for row in rows for fault in row.faults]
    kinds = "".join(
        _kind(name, of_kind)
        for key, name in _FROM.items()
        if (of_kind := [row for row in rows if row.plans_from == key])
    )
    return _PAGE.format(seed=seed, kinds=kinds, answers=answers, faults="".join(found[:_MOST_SHOWN]) or "None.\n")


def _kind(name: str, rows: Sequence[RaceRow]) -> str:
    requests, motions = sum(len(row.answers) for row in rows), sum(row.motions for row in rows)
    stopped, faults = sum(row.with_stop for row in rows), sum(len(row.faults) for row in rows)
    return (
        f"| {name} | {len(rows)} | {requests} | {motions} | {stopped} | {median(row.took_s for row in rows):.1f} s "
        f"| {faults} (limit 0) |\n"
    )

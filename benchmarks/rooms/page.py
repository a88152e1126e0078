"""`docs/benchmarks/rooms.md`."""

import os
from collections.abc import Iterator
from typing import Final

from benchmarks.rooms.figures import Disturbance, Figures, Growth

# Chosen: above what the rooms, the site elsewhere and their floods make of two processors.
_MOST_LOAD: Final = 4.0
KINDS: Final = ("stop", "command", "state")
_HEAD: Final = """# Many rooms at one site

Made by `distalock bench rooms`. Each room has a router, an exporter and light services: sessions with the services' own
certificates that send what the services send (heartbeats, status, the robot's state at 20 Hz) and answer commands
without the services' work. The measured room's processes have one processor of this machine and everything else has the
other, for in a hospital each room has a machine. Between room and site stands a relay of TCP with 20 ms each way: this
machine's kernel has no `netem`, so loss is what a program on TCP sees of it (a lost segment, and all behind it, comes
200 ms later), and a partition carries nothing and closes nothing. How it is built, and why:
[decision 57](../decisions/0057-many-rooms.md).

## A room beside a disturbance

A ratio is the median over the rounds of the ratio of medians, with and without; the limit is {limit:g}. Processors of
one machine slow one another, machines in a hospital do not: a flood is compared with the same flood on the same
processor at another site. What that alone does is in the last row, which has no limit.

| meanwhile | of | median without -> with | 99 % without -> with | ratio | no answer without -> with |
|---|---|---|---|---|---|
"""
_GROWTH_HEAD: Final = """
## Growth

All on this machine's processors at once, light services included. Memory is of one router or exporter, on the average;
shares are of one processor.

| rooms | site router | room router | exporter | site router uses | exporter uses | a room sends | change seen after |
|---|---|---|---|---|---|---|---|
"""


def page(figures: Figures, limit: float) -> str:
    """The page."""
    rows = "".join(row for one in (*figures.disturbances, figures.of_machine) for row in _disturbance(one))
    growth = "".join(map(_growth, figures.growth))
    again = (
        f"\nAfter a partition the desk sees the room again in {figures.seen_again_s:.1f} s; it shows a room as silent "
        "after 3 s. Nothing in the room waits for the site.\n"
    )
    return _HEAD.format(limit=limit) + rows + again + _GROWTH_HEAD + growth + _load(os.getloadavg()[1])


def _load(load: float) -> str:
    """How busy the machine was, and what that means."""
    processors = os.cpu_count() or 1
    said = f"\nLoad average of five minutes at its end: {load:.1f}, {processors} processors."
    if load <= _MOST_LOAD * processors:
        return f"{said}\n"
    return (
        f"{said} Other programs had the measured room's processor most of the time, also in the rounds without a "
        "disturbance: **its ratios show nothing**, and questions without an answer are links that were lost for want "
        "of time. Memory, bytes and shares of processor time hold.\n"
    )


def _disturbance(one: Disturbance) -> Iterator[str]:
    for kind in KINDS:
        (median, median_with), (late, late_with) = one.percentile_ms(kind, 50.0), one.percentile_ms(kind, 99.0)
        yield (
            f"| {one.name if kind == KINDS[0] else ''} | {kind} | {median:.2f} -> {median_with:.2f} ms "
            f"| {late:.2f} -> {late_with:.2f} ms | {one.ratio(kind):.2f} "
            f"| {' -> '.join(map(str, one.lost)) if kind == KINDS[0] else ''} |\n"
        )


def _growth(one: Growth) -> str:
    return (
        f"| {one.rooms} | {one.site_mib:.0f} MiB | {one.router_mib:.0f} MiB | {one.exporter_mib:.0f} MiB "
        f"| {one.site_share:.1%} | {one.exporter_share:.1%} | {one.bytes_per_s / 1e3:.1f} kB/s "
        f"| {one.late_s[0]:.2f} s (99 %: {one.late_s[1]:.2f} s) |\n"
    )

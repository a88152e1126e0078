"""A thousand procedures in the virtual room, with errors of people, images out of the model and faults of hardware.

usage: distalock bench campaign [--count 1000] [--seed 90000] [--rows FILE] [--processes 2] [--scheduler ADDRESS]

Writes docs/benchmarks/campaign.md and `docs/risk/campaign.json`, from which the FMEA takes its frequencies. With
`--rows FILE` a run continues where it ended. One procedure alone (`--count 1 --seed N`) prints what happened in it and
writes nothing.
"""

import json
import logging
import sys
from collections.abc import Sequence

import structlog

from benchmarks.campaign.fmea_counts import counts_of
from benchmarks.campaign.page import page
from benchmarks.campaign.play import play
from benchmarks.campaign.rows import CaseRow, Ending
from benchmarks.common.places import PAGES, ROOT
from benchmarks.common.runner import SceneOptions, run_jobs

REPORT = PAGES / "campaign.md"
COUNTS = ROOT / "docs" / "risk" / "campaign.json"
_OPTIONS = SceneOptions("campaign", (__doc__ or "").splitlines()[0], count=1000, seed=90_000, report=REPORT)


def quiet_play(seed: int) -> CaseRow:
    """Play one procedure without the services' own log."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    logging.disable(logging.CRITICAL)
    return play(seed)


def main(arguments: Sequence[str] = ()) -> int:
    """Play all procedures, write the page; 1 when one of them harmed or crashed."""
    given = _OPTIONS.parse(arguments)
    rows = list(run_jobs(quiet_play, given.seeds, CaseRow, given.plan).values())
    failed = any(row.ending in (Ending.HARM, Ending.CRASHED) for row in rows)
    if len(rows) == 1:
        print("\n".join(story(rows[0])))
        return int(failed)
    text = page(rows, given.seed)
    given.report.write_text(text, encoding="utf-8")
    if given.report == REPORT:
        COUNTS.write_text(json.dumps(counts_of(rows), indent=1) + "\n", encoding="utf-8")
    print(text)
    return int(failed)


def story(row: CaseRow) -> list[str]:
    """What happened in one procedure."""
    wrong = "; ".join(
        filter(
            None,
            (row.error and f"{row.error} ({row.error_at})", row.image, row.fault and f"{row.fault} ({row.fault_at})"),
        )
    )
    holes = [
        f"  {hole.hole_id}: off by {hole.entry_mm:.2f} mm and {hole.angle_deg:.2f}°, "
        f"{'passed' if hole.passed else 'struck'}, {'allowed' if hole.allowed else 'against advice'}"
        for hole in row.holes
    ]
    return [
        f"seed {row.seed}: {row.ending}",
        f"wrong: {wrong or 'nothing'}",
        f"{row.images} images, {row.moves} moves, {row.stops} stops",
        *(f"  {one.moment}: {one.code}: {one.sentence}" for one in row.noticed),
        *holes,
        *(f"HARM {harm}" for harm in row.harms),
        *([f"ended because {row.why}"] if row.why else []),
    ]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

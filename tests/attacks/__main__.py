"""`make attacks`: try every attack of the table on a running system; exit code 1 when one is not refused as declared.

usage: python -m tests.attacks [NAME ...]
"""

import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tests.attacks.runner import Verdict, tried
from tests.attacks.site import approved_move, running_site
from tests.attacks.table import AFTER_THE_MOVE, ATTACKS, BEFORE_THE_MOVE, PAGE, page_with_table


def main(names: Sequence[str]) -> int:
    """Run the attacks that are named, or all; all of them rewrite the page."""
    chosen = [attack for attack in ATTACKS if not names or attack.name in names]
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="distalock-attacks-") as folder, running_site(Path(folder)) as site:
        print(f"the system runs after {time.monotonic() - began_s:.0f} s; {len(chosen)} attacks", flush=True)
        verdicts = [_told(tried(attack, site)) for attack in chosen if attack in BEFORE_THE_MOVE]
        if not names:
            print(f"control: {approved_move(site)}", flush=True)
        verdicts += [_told(tried(attack, site)) for attack in chosen if attack in AFTER_THE_MOVE]
    failed = [verdict for verdict in verdicts if not verdict.held]
    print(f"{len(verdicts) - len(failed)} of {len(verdicts)} attacks refused in {time.monotonic() - began_s:.0f} s")
    if not failed and not names:
        PAGE.write_text(page_with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    return 1 if failed else 0


def _told(verdict: Verdict) -> Verdict:
    print(f"{'refused' if verdict.held else 'FAILED ':8} {verdict.attack.name}: {verdict.seen}", flush=True)
    return verdict


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""`distalock risk`: the risk file in `docs/risk` against the tests that ran. It needs a checkout of the sources."""

import argparse
import importlib
import sys
from pathlib import Path
from typing import Final

from distalock.arguments import named_path, whole_number
from shared.arguments import EXIT_BAD_INPUT

ROOT: Final = Path(__file__).resolve().parent.parent
_RESULTS: Final = ROOT / ".test-results"
_MOST_AGE_H: Final = 24


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the commands."""
    commands = parser.add_subparsers(dest="risk_command", required=True, metavar="COMMAND")
    check = commands.add_parser("check", help="fails when a control of a hazard has no test that ran and passed")
    check.add_argument(
        "--results", type=named_path, default=_RESULTS, metavar="FOLDER", help="where `make test` leaves its results"
    )
    check.add_argument(
        "--most-age-h",
        type=whole_number("a number of hours", 1, 10_000),
        default=_MOST_AGE_H,
        metavar="H",
        help=f"results count for so long ({_MOST_AGE_H})",
    )
    check.add_argument(
        "--with-long-tests", action="store_true", help="those must have run as well: after `make long-tests`"
    )
    check.set_defaults(run_risk=_check)
    audit = commands.add_parser("audit", help="known vulnerabilities of what requirements.lock pins, by pip-audit")
    audit.set_defaults(run_risk=_audit)


def run(given: argparse.Namespace) -> int:
    """Run one of the commands; 2 without a checkout."""
    if not (ROOT / "tools" / "risk").is_dir():
        where = ROOT / "docs" / "risk"
        print(f"distalock risk: there is no folder {where}; it needs a checkout of the sources", file=sys.stderr)
        return EXIT_BAD_INPUT
    sys.path.insert(0, str(ROOT))
    return int(given.run_risk(given))


def _check(given: argparse.Namespace) -> int:
    check = importlib.import_module("tools.risk.check")
    return int(check.main(given.results, given.most_age_h, with_long_tests=given.with_long_tests))


def _audit(_: argparse.Namespace) -> int:
    return int(importlib.import_module("tools.risk.audit").main())

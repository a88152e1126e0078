"""`make model-check`: searches every scope, prints what was visited, and sees that every seeded mutation is caught."""

import argparse
import sys
import time
from collections.abc import Sequence

from tests.model.check import all_mutations, all_scopes
from tests.model.mutations import MUTATIONS
from tests.model.report import mutations_table, scopes_table
from tests.model.scope import SCOPES


def main(arguments: Sequence[str] | None = None) -> int:
    """1 when a property does not hold, a search is not complete, or a mutation is not caught."""
    parser = argparse.ArgumentParser(prog="python -m tests.model", description=__doc__)
    parser.add_argument("--traces", action="store_true", help="print how each mutation breaks its property")
    options = parser.parse_args(arguments)
    began_s = time.monotonic()
    found = all_scopes()
    print(scopes_table(SCOPES, found), flush=True)
    violations = [one.violation for one in found if one.violation is not None]
    for violation in violations:
        print(violation)
    caught = all_mutations()
    print(mutations_table(MUTATIONS, caught))
    missed = [m.says for m, one in zip(MUTATIONS, caught, strict=True) if one.violation is None]
    if options.traces:
        for mutation, one in zip(MUTATIONS, caught, strict=True):
            print(f"\n{mutation.says}\n{one.violation}")
    took_s = time.monotonic() - began_s
    print(f"{len(MUTATIONS) - len(missed)} of {len(MUTATIONS)} mutations caught; {took_s:.0f} s in all")
    for says in missed:
        print(f"not caught: {says}")
    return 1 if violations or missed else 0


if __name__ == "__main__":
    sys.exit(main())

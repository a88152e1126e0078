"""`distalock bench containers`: sizes, first image, frames, and every container killed, paused and cut off."""

import argparse
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

from benchmarks.common.places import PAGES
from benchmarks.containers.faults import FAULTS, ContainerFinding, play
from benchmarks.containers.figures import ImageTimes, frames_by_path, image_times, resident_mib
from benchmarks.containers.page import page
from benchmarks.containers.site import container_site
from benchmarks.faults.patient import STEPS, Step
from distalock.arguments import OneLineParser
from distalock.version import revision
from shared.errors import DistalockError
from tools.containers.composition import IMAGES, Composition

_PROJECT: Final = "distalock-bench"
_BYTES_PER_MB: Final = 1e6
# Short of all: those at which the installation does different things.
_USUAL_STEPS: Final = (Step.IMAGE_TAKEN, Step.MOVING, Step.LOCKED)


def main(arguments: Sequence[str]) -> int:
    """Exit code 0 when every limit held."""
    parser = OneLineParser(prog="distalock bench containers", description=__doc__)
    parser.add_argument("--fault", action="append", choices=[f.name for f in FAULTS], help="only this one; repeatable")
    parser.add_argument("--step", action="append", choices=list(STEPS), help="at this step; repeatable")
    parser.add_argument("--no-build", action="store_true", help="images are there already")
    parser.add_argument("--no-faults", action="store_true", help="figures alone")
    return _run(parser.parse_args(list(arguments)))


def _run(given: argparse.Namespace) -> int:
    try:
        composition = Composition(_PROJECT)
        if not given.no_build:
            composition.build()
        sizes = {image: composition.layers_bytes(image) / _BYTES_PER_MB for image in IMAGES}
        with container_site(composition) as site:
            times: ImageTimes = image_times(site)
            print(f"first image {times.first_s:.2f} s, second {times.second_s:.2f} s", flush=True)
            paths = frames_by_path(site)
            print(f"frames: {paths}", flush=True)
            memory = {name: resident_mib(site, name) for name in ("registration", "imaging", "robot", "router")}
            findings: list[ContainerFinding] = []
            chosen = [f for f in FAULTS if given.fault is None or f.name in given.fault]
            steps = [step for step in STEPS if step in (given.step or _USUAL_STEPS)]
            for finding in play(site, [] if given.no_faults else chosen, steps):
                findings.append(finding)
                print(finding.line, flush=True)
    except DistalockError as error:
        print(f"distalock bench containers: {error}", file=sys.stderr)
        return 2
    made_of = f"{datetime.now(UTC).date().isoformat()}, revision {revision() or 'unknown'}"
    text, held = page(made_of, sizes, times, paths, memory, findings)
    (PAGES / "containers.md").write_text(text, encoding="utf-8")
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

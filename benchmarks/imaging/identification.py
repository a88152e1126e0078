"""Ring from what is left of it: `distalock bench imaging_identification [SEEDS]`.

60 % of the shipped ring's balls are left, lost at random or all around one place; any rotation, mirrored or not, both
kinds of distortion, focal spot and nominal values wrong by up to ten per cent, forty other discs (a guide, screws,
wires). Centres are given as detection gives them: geometry alone, no pixels.
"""

import sys
import time
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from benchmarks.common.places import PAGES
from benchmarks.imaging.scenes import SIZE_PX, Distortion, left_over, random_c_arm, ring_shadow, shipped_ring
from services.imaging.core.identification import identify_ring
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_search import is_ambiguous, is_enough
from shared.geometry.calibration import BallCandidates
from shared.geometry.parts import RingPart

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OTHERS = 40
JITTER_PX = 0.15
REPORT = PAGES / "identification.md"


def discs(ring: RingPart, present: Mask, rng: np.random.Generator) -> tuple[BallCandidates, Array]:
    """What detection would give, in random order, and where each ball of the ring is."""
    c_arm = random_c_arm(rng, rng.choice([Distortion.QUINTIC, Distortion.FREE]))
    shadow = ring_shadow(c_arm, ring)
    truth = shadow.centre_px
    if rng.random() < 0.5:
        truth = np.column_stack([SIZE_PX - 1 - truth[:, 0], truth[:, 1]])
    centre = np.concatenate([truth[present], rng.uniform(230.0, 790.0, (OTHERS, 2))])
    centre += rng.normal(0.0, JITTER_PX, centre.shape)
    radius = np.concatenate([rng.uniform(0.75, 1.0) * shadow.radius_px[present], rng.uniform(4.0, 7.5, OTHERS)])
    order, ones = rng.permutation(len(radius)), np.ones(len(radius))
    none = np.full(len(radius), -1, dtype=np.int64)
    return BallCandidates(centre[order], radius[order], ones, JITTER_PX * ones, none), truth


def outcome(seed: int, lost: str, ring: RingPart) -> tuple[str, float]:
    """What came of one seed, and the runner-up's part of the best."""
    rng = np.random.default_rng([seed, len(lost)])
    present = left_over(ring, lost, rng)
    candidates, truth = discs(ring, present, rng)
    nominal = NominalGeometry(1000.0 * rng.uniform(0.91, 1.09), 0.235 * rng.uniform(0.91, 1.09))
    identity = identify_ring(candidates, ring, nominal)
    if identity is None or not is_enough(identity, ring):
        return "not found", 1.0
    margin = identity.runner_up / identity.identified
    if is_ambiguous(identity):
        return "refused as ambiguous", margin
    named = np.flatnonzero(identity.candidate_of_ball >= 0)
    off = np.hypot(*(candidates.centre_px[identity.candidate_of_ball[named]] - truth[named]).T)
    # Another disc may lie within a shadow's breadth of where a lost ball would be; measuring decides on those.
    right = float(np.mean(off < 3.0))
    return ("identified" if right > 0.9 else "WRONG"), margin


def main(seeds: int = 1000) -> int:
    ring = shipped_ring()
    lines = ["| lost | identified | ambiguous | not found | wrong | worst runner-up | ms |", "|" + "---|" * 7]
    wrong = 0
    for lost in ("random", "patch"):
        started = time.process_time()
        results = [outcome(seed, lost, ring) for seed in range(seeds)]
        milliseconds = 1e3 * (time.process_time() - started) / seeds
        count = Counter(name for name, _ in results)
        wrong += count["WRONG"]
        worst = max(margin for name, margin in results if name == "identified")
        lines.append(
            f"| {lost} | {count['identified']} | {count['refused as ambiguous']} | {count['not found']} "
            f"| {count['WRONG']} | {100 * worst:.0f} % | {milliseconds:.0f} |"
        )
        print(lines[-1], flush=True)
    if seeds >= 1000:
        REPORT.write_text(
            "# Identification of the ring\n\nMade by `distalock bench imaging_identification`: "
            f"{seeds} seeds a row. {(__doc__ or '').split(chr(10), 2)[2].strip()}\n\n" + "\n".join(lines) + "\n"
        )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000))

"""Whether images from two and three directions show a guide of another size than its file says.

usage: distalock bench guide_scale [--count 4] [--seed 60200]

Each set-up is seen from the directions A, B and C of `benchmarks.accuracy.fusion`, with the guide as filed, 1 % and 3 %
larger, and localised with the file.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.accuracy.fusion import directions_deg
from benchmarks.scenes.changed_parts import with_scaled_guide
from benchmarks.scenes.set_ups import SetUp
from services.registration.core.fusion import ImageResult, fuse_localisations

SCALES = (1.0, 1.01, 1.03)
_DIRECTIONS = {"A": 0, "B": 2, "C": 3}


def main(arguments: Sequence[str] = ()) -> int:
    """Print a line for each set-up, scale and combination of images."""
    parser = argparse.ArgumentParser(prog="distalock bench guide_scale", description=__doc__)
    parser.add_argument("--count", type=int, default=4)
    parser.add_argument("--seed", type=int, default=60_200)
    given = parser.parse_args(list(arguments))
    for seed in range(given.seed, given.seed + given.count):
        for scale in SCALES:
            images = seen_from_three_directions(seed, scale)
            print(f"{seed}, {scale:.2f}: {said_of(seed, images[:2])}; {said_of(seed, images)}", flush=True)
    return 0


def seen_from_three_directions(seed: int, scale: float) -> tuple[ImageResult, ...]:
    """Images in which the ring was found, with what was localised by the file of an unscaled guide."""
    own = SetUp.of_seed(seed)
    built = replace(own, scenario=with_scaled_guide(own.scenario, scale))
    leans, images = directions_deg(seed), []
    for name, number in _DIRECTIONS.items():
        seen = built.turned(*leans[number]).seen(number)
        if seen.result is not None:
            pixels = seen.shot.pixels.astype(np.float32)
            images.append(ImageResult(name, pixels, seen.calibration, seen.result))
    return tuple(images)


def said_of(seed: int, images: tuple[ImageResult, ...]) -> str:
    """Chi-square of some images together, with its limit, and the conclusion."""
    names = ", ".join(image.name for image in images)
    fused = fuse_localisations(images, SetUp.of_seed(seed).parts)
    if fused is None:
        return f"{names}: none can be used"
    reasons = [reason.message for reason in fused.result.reasons]
    size = next((message.split("the guide is ")[1][:7] for message in reasons if "the guide is " in message), "")
    said = f"guide at {size}" if size else ", ".join(reason.code for reason in fused.result.reasons) or "accepted"
    return f"{names}: chi-square {fused.chi_square:.0f} (limit {fused.chi_square_limit:.0f}), {said}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

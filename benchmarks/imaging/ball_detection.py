"""Balls in images with other steel over them: `distalock bench ball_detection [IMAGES]`.

Each image shows the shipped ring; 0, 20 or 40 % of its balls are covered in part by another ball. Everyone gets the
same images and the radii to look for. Recall counts the ring's balls found within two pixels; precision counts what was
found that is a ball of whatever kind; rms is that of centres found. The table goes to docs/benchmarks/balls.md.
"""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.common.places import PAGES
from benchmarks.imaging.scenes import (
    ABSORPTION,
    Distortion,
    Exposure,
    Shadow,
    displayed,
    exposed,
    noise_of,
    patient,
    random_c_arm,
    ring_shadow,
    shipped_ring,
    transmission,
)
from benchmarks.limits.balls_and_rays import centre_variance_px2
from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from shared.errors import Rejected
from shared.geometry.parts import RingPart
from shared.xray.aperture import find_usable_area
from shared.xray.detection import detect_balls, disc_correlation

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FloatImage = NDArray[np.float32]

NEAR_PX = 2.0
RIM_PX = 470.0
CONTRAST_TO_NOISE = 15.0
REPORT = PAGES / "balls.md"


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """An image with its truth; `overlapped` marks balls of the ring that another shadow touches."""

    pixels: FloatImage
    ring: Shadow
    others: Shadow
    inside: Mask
    overlapped: Mask
    limit_px: Array


def make_scene(seed: int, covered: float, ring: RingPart) -> Scene:
    """One image; `limit_px` is the Cramér-Rao limit of each ball's centre, per axis."""
    rng = np.random.default_rng([seed, round(100 * covered)])
    shadow = ring_shadow(random_c_arm(rng, Distortion.QUINTIC), ring)
    others = _covering(shadow, covered, rng)
    together = Shadow(
        *(
            np.concatenate([getattr(shadow, name), getattr(others, name)])
            for name in ("centre_px", "radius_px", "absorption")
        )
    )
    light = patient(rng)
    grey = displayed(light * transmission(together))
    gap = np.hypot(*(shadow.centre_px[:, None] - together.centre_px[None]).transpose(2, 0, 1))
    gap -= shadow.radius_px[:, None] + together.radius_px[None]
    gap[np.arange(len(gap)), np.arange(len(gap))] = np.inf
    inside = np.hypot(*(shadow.centre_px - 511.5).T) + shadow.radius_px < RIM_PX
    noise = noise_of(CONTRAST_TO_NOISE, light, shadow)
    variance = [centre_variance_px2(together, k, light, noise) if inside[k] else np.nan for k in range(len(gap))]
    pixels = exposed(grey, Exposure(noise), rng)
    return Scene(pixels, shadow, others, inside, gap.min(axis=1) < 1.0, np.sqrt(variance))


def _covering(shadow: Shadow, covered: float, rng: np.random.Generator) -> Shadow:
    """Balls of a guide that lie over some of the ring's, and touch none of the rest."""
    chosen = rng.permutation(len(shadow.radius_px))[: round(covered * len(shadow.radius_px))]
    radius = rng.choice([6.3, 6.9], len(chosen))
    reach = (shadow.radius_px[chosen] + radius) * rng.uniform(0.4, 1.0, len(chosen))
    angle = rng.uniform(0.0, 2.0 * np.pi, len(chosen))
    centre = shadow.centre_px[chosen] + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Shadow(centre, radius, np.full(len(chosen), ABSORPTION))


def smallest_and_largest(ring: RingPart) -> tuple[float, float]:
    low, high = NominalGeometry().ball_radius_range_px(ring)
    return 0.85 * low, 1.1 * high


def ours(scene: Scene, ring: RingPart) -> Array:
    area = find_usable_area(scene.pixels)
    low, high = NominalGeometry().ball_radius_range_px(ring)
    return detect_balls(scene.pixels, area.mask, (0.8 * low, 1.2 * high)).centre_px


def _eight_bits(scene: Scene) -> NDArray[np.uint8]:
    return np.asarray(np.clip(scene.pixels / 256.0, 0, 255), dtype=np.uint8)


def simple_blobs(scene: Scene, ring: RingPart) -> Array:
    """OpenCV's SimpleBlobDetector, every filter but area and circularity off; the best of three thresholds tried."""
    low, high = smallest_and_largest(ring)
    settings = cv2.SimpleBlobDetector.Params()
    settings.minThreshold, settings.maxThreshold, settings.thresholdStep = 5.0, 250.0, 5.0
    settings.filterByArea, settings.minArea, settings.maxArea = True, 0.4 * np.pi * low**2, 1.5 * np.pi * high**2
    settings.filterByCircularity, settings.minCircularity = True, 0.6
    settings.filterByConvexity, settings.filterByInertia = False, False
    settings.minDistBetweenBlobs = low
    found = cv2.SimpleBlobDetector.create(settings).detect(cv2.GaussianBlur(_eight_bits(scene), (0, 0), 1.0))
    return np.array([k.pt for k in found], dtype=np.float64).reshape(-1, 2)


def hough_circles(scene: Scene, ring: RingPart) -> Array:
    """OpenCV's HoughCircles, gradient with alternative voting is worse here; the best of four thresholds tried."""
    low, high = smallest_and_largest(ring)
    image = cv2.GaussianBlur(_eight_bits(scene), (0, 0), 1.0)
    found = cv2.HoughCircles(
        image, cv2.HOUGH_GRADIENT, 1, low, param1=120, param2=9, minRadius=int(low * 0.7), maxRadius=int(np.ceil(high))
    )
    return np.zeros((0, 2)) if found is None else np.asarray(found[0, :, :2], dtype=np.float64)


def correlation(scene: Scene, ring: RingPart) -> Array:
    """Normalised cross-correlation with discs of two sizes, peaks above 0.55 refined by parabolas."""
    low, high = smallest_and_largest(ring)
    best = np.maximum(*(disc_correlation(scene.pixels, r) for r in (low, high)))
    size = 2 * round(0.7 * low) + 1
    rows, columns = np.nonzero((best >= cv2.dilate(best, np.ones((size, size), np.uint8))) & (best > 0.55))
    keep = (rows > 0) & (columns > 0) & (rows < best.shape[0] - 1) & (columns < best.shape[1] - 1)
    rows, columns = rows[keep], columns[keep]
    middle = best[rows, columns]
    shift = []
    for dy, dx in ((0, 1), (1, 0)):
        more, less = best[rows + dy, columns + dx], best[rows - dy, columns - dx]
        shift.append(0.5 * (more - less) / np.maximum(2.0 * middle - more - less, 1e-9))
    return np.stack([columns + shift[0], rows + shift[1]], axis=1).astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """Sums over images: balls there, found, detections, those that are balls; squared errors over squared limits."""

    there: int
    found: int
    named: int
    right: int
    isolated: Array
    overlapped: Array
    error_px: Array
    seconds: float


def score_of(scene: Scene, found_px: Array, seconds: float) -> Score:
    """Compare unnamed detections with the truth."""
    inner = np.hypot(*(found_px - 511.5).T) < RIM_PX
    found_px = found_px[inner]
    truth = scene.ring.centre_px
    distance = np.hypot(*(truth[:, None] - found_px[None]).transpose(2, 0, 1))
    nearest = distance.argmin(axis=1) if len(found_px) else np.zeros(len(truth), int)
    hit = scene.inside & (distance.min(axis=1, initial=np.inf) < NEAR_PX)
    every = np.concatenate([truth, scene.others.centre_px])
    away = np.hypot(*(found_px[:, None] - every[None]).transpose(2, 0, 1)).min(axis=1, initial=np.inf)
    error = found_px[nearest[hit]] - truth[hit] if hit.any() else np.zeros((0, 2))
    return _score(scene, hit, error, (len(found_px), int(np.count_nonzero(away < NEAR_PX))), seconds)


def _score(scene: Scene, hit: Mask, error: Array, named: tuple[int, int], seconds: float) -> Score:
    squared = 0.5 * np.square(error).sum(axis=1)
    ratio = np.column_stack([squared, scene.limit_px[hit] ** 2])
    covered = scene.overlapped[hit]
    there = int(np.count_nonzero(scene.inside))
    return Score(there, int(hit.sum()), *named, ratio[~covered], ratio[covered], squared, seconds)


def calibrated(scene: Scene, ring: RingPart) -> Score:
    """The whole calibration: identified by name, neighbours modelled."""
    started = time.process_time()
    outcome = calibrate_image(scene.pixels, ring, NominalGeometry())
    seconds = time.process_time() - started
    if isinstance(outcome, Rejected):
        raise SystemExit(f"an image of the benchmark was refused: {outcome.reasons}")
    balls = outcome.value.balls
    named = balls.ring_index >= 0
    index, centre = balls.ring_index[named], balls.centre_px[named]
    error = centre - scene.ring.centre_px[index]
    near = (np.hypot(*error.T) < NEAR_PX) & scene.inside[index]
    hit = np.zeros(len(scene.inside), bool)
    hit[index[near]] = True
    order = np.argsort(index[near])
    inner = scene.inside[index]
    return _score(scene, hit, error[near][order], (int(inner.sum()), int(near.sum())), seconds)


def unnamed(detector: Callable[[Scene, RingPart], Array]) -> Callable[[Scene, RingPart], Score]:
    """A detector as a method to be scored."""

    def method(scene: Scene, ring: RingPart) -> Score:
        started = time.process_time()
        found = detector(scene, ring)
        return score_of(scene, found, time.process_time() - started)

    return method


METHODS: dict[str, Callable[[Scene, RingPart], Score]] = {
    "distalock, calibrated": calibrated,
    "distalock, candidates": unnamed(ours),
    "cv2 SimpleBlobDetector": unnamed(simple_blobs),
    "cv2 HoughCircles": unnamed(hough_circles),
    "correlation (NCC)": unnamed(correlation),
}


def row(name: str, covered: float, scores: Sequence[Score]) -> str:
    there, found, named, right = (sum(getattr(s, key) for s in scores) for key in ("there", "found", "named", "right"))
    error = np.sqrt(np.mean(np.concatenate([s.error_px for s in scores])))
    cells = [f"{100 * found / there:.2f}", f"{100 * right / max(named, 1):.2f}", f"{error:.3f}"]
    for kind in ("isolated", "overlapped"):
        values = np.concatenate([getattr(s, kind) for s in scores])
        cells.append(f"{np.sqrt(values[:, 0].mean() / values[:, 1].mean()):.2f}" if len(values) > 20 else "-")
    cells.append(f"{1e3 * np.median([s.seconds for s in scores]):.0f}")
    return f"| {name} | {100 * covered:.0f} % | " + " | ".join(cells) + " |"


def main(images: int = 8) -> int:
    ring = shipped_ring()
    lines = ["| | covered | recall % | precision % | rms px | rms/limit isolated | overlapped | ms |", "|" + "---|" * 8]
    calibrated(make_scene(0, 0.0, ring), ring)  # compiles
    for covered in (0.0, 0.2, 0.4):
        scenes = [make_scene(seed, covered, ring) for seed in range(images)]
        for name, method in METHODS.items():
            lines.append(row(name, covered, [method(scene, ring) for scene in scenes]))
            print(lines[-1], flush=True)
    print(f"{images} images each; seeds 0 to {images - 1}")
    if images >= 8:
        REPORT.write_text(_document(lines, images))
    return 0


def _document(lines: list[str], images: int) -> str:
    return f"""# Ball detection

Made by `distalock bench ball_detection` ({images} images a row, seeds 0 to {images - 1}, contrast-to-noise ratio
15 of the middle ball, white noise). The ring's 120 balls lie over a leg; some are covered in part by another ball. A
centre within 2 px counts as found. The limit is Cramér-Rao's, with radius, contrast, background, blur and the touching
balls unknown as well. `calibrated` is what leaves imaging: every ball by name, precision counts wrong names; its time
is that of the whole calibration. The others give discs without names. One core.

{chr(10).join(lines)}

scikit-image's `blob_log` is left out: see decision record 8.
"""


if __name__ == "__main__":
    cv2.setNumThreads(1)
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 8))

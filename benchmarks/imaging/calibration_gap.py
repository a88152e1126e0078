"""Where a calibration's error comes from: `python -m benchmarks.imaging.calibration_gap [IMAGES]`.

The same images as in `imaging_calibration`, balls lost at random, each with three draws of noise. The field and the
focal spot are estimated from true centres, from true centres with white noise at each ball's Cramér-Rao limit, and from
centres as measured where the balls are. Beside the rays stand bias and scatter of the measured centres over their
limit: scatter is what changes with the noise, bias what remains. The table goes to docs/benchmarks/calibration-gap.md.
"""

import sys
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.baselines.calibration_peers import START_MM, Rays
from benchmarks.common.places import PAGES
from benchmarks.imaging.calibration import CONTRAST_TO_NOISE, ray_errors_px, rms, targets
from benchmarks.imaging.scenes import (
    SIZE_PX,
    Distortion,
    Exposure,
    Shadow,
    displayed,
    exposed,
    left_over,
    noise_of,
    patient,
    random_c_arm,
    ring_shadow,
    shipped_ring,
    transmission,
)
from benchmarks.limits.balls_and_rays import centre_variance_px2
from services.imaging.core.calibration import similarity_near
from services.imaging.core.joint_estimate import NominalSource, Observations, estimate_jointly, on_plane
from shared.geometry.parts import RingPart
from shared.xray.aperture import find_usable_area
from shared.xray.measurement import MeasurementSettings, measure_balls

Array = NDArray[np.float64]

DRAWS = 3
SHRUNK = 0.9
LOOK = MeasurementSettings(reach_px=6.0, drift_px=0.35)
NOMINAL = NominalSource(START_MM, np.array([100.0, 100.0, 150.0]))
REPORT = PAGES / "calibration-gap.md"


def estimated_rays(position_mm: Array, centre_px: Array, deviation_px: Array, at_px: Array) -> Rays:
    """Rays through pixels from the product's own field model, by centres of balls and their deviations."""
    middle = np.full(2, 0.5 * (SIZE_PX - 1))
    gauge = similarity_near(on_plane(position_mm, START_MM), centre_px, middle, 0.25 * SIZE_PX)
    observations = Observations(centre_px, deviation_px, position_mm)
    first = estimate_jointly(observations, START_MM, NOMINAL, gauge)
    gauge = similarity_near(on_plane(position_mm, first.source_mm), centre_px, middle, 0.25 * SIZE_PX)
    found = estimate_jointly(observations, first.source_mm, NOMINAL, gauge, first.solution.prior)
    ideal = at_px + found.solution.predict(at_px)[0]
    plane = (ideal - gauge.offset_px) @ gauge.rotation / gauge.scale_px_per_mm
    return Rays(found.source_mm, np.column_stack([plane, np.zeros(len(plane))]) - found.source_mm)


@dataclass(slots=True)
class Tally:
    """Ray errors by where the centres come from; bias and scatter of measured centres over their limit."""

    rays_px: dict[str, list[Array]] = field(default_factory=dict)
    bias: list[Array] = field(default_factory=list)
    scatter: list[Array] = field(default_factory=list)


def one_image(seed: int, distortion: Distortion, ring: RingPart, tally: Tally) -> None:
    rng = np.random.default_rng([seed, len("random"), len(distortion)])
    c_arm = random_c_arm(rng, distortion)
    present = left_over(ring, "random", rng)
    shadow, light = ring_shadow(c_arm, ring).select(present), patient(rng)
    noise = noise_of(CONTRAST_TO_NOISE, light, shadow)
    grey = displayed(light * transmission(shadow))
    limit = np.sqrt([centre_variance_px2(shadow, k, light, noise) for k in range(len(shadow.radius_px))])
    position, points = ring.balls.position_mm[present], targets()
    at_px = c_arm.image(points)
    errors = []
    for _ in range(DRAWS):
        noisy = shadow.centre_px + limit[:, None] * rng.normal(size=shadow.centre_px.shape)
        centre, deviation = _measured(exposed(grey, Exposure(noise), rng), shadow)
        seen = np.isfinite(deviation)
        errors.append((centre - shadow.centre_px) / limit[:, None])
        sources = {
            "true centres": (shadow.centre_px, limit),
            "true centres and noise at the limit": (noisy, limit),
            "measured centres": (centre, deviation),
        }
        for name, (px, sd) in sources.items():
            rays = estimated_rays(position[seen], px[seen], sd[seen], at_px)
            tally.rays_px.setdefault(name, []).append(ray_errors_px(rays, points, c_arm))
    draws = np.array(errors)
    whole = np.isfinite(draws).all(axis=(0, 2))
    tally.bias.append(draws[:, whole].mean(axis=0))
    tally.scatter.append(draws[:, whole].var(axis=0, ddof=1))


def _measured(pixels: NDArray[np.float32], shadow: Shadow) -> tuple[Array, Array]:
    """Centres and deviations of balls measured where they are, NaN where one is not seen."""
    usable = find_usable_area(pixels).mask
    found = measure_balls(pixels, shadow.centre_px, SHRUNK * shadow.radius_px, settings=LOOK, usable=usable)
    return found.centre_px, np.where(found.seen, found.standard_deviation_px, np.nan)


def main(images: int = 12) -> int:
    ring = shipped_ring()
    lines: list[str] = []
    for distortion in (Distortion.QUINTIC, Distortion.FREE):
        tally = Tally()
        for seed in range(images):
            one_image(seed, distortion, ring, tally)
        if not lines:
            names = " | ".join(f"{name}, rays px" for name in tally.rays_px)
            lines = [f"| distortion | {names} | centres: scatter / limit | bias / limit |", "|" + "---|" * 6]
        variance = float(np.mean(np.concatenate(tally.scatter)))
        squared = float(np.mean(np.square(np.concatenate(tally.bias)))) - variance / DRAWS
        cells = " | ".join(f"{rms(errors):.3f}" for errors in tally.rays_px.values())
        lines.append(f"| {distortion} | {cells} | {np.sqrt(variance):.2f} | {np.sqrt(max(squared, 0.0)):.2f} |")
        print("\n".join(lines), flush=True)
    if images >= 12:
        text = (__doc__ or "").split("\n", 2)[2].strip()
        head = "# Where the calibration's error comes from\n\nMade by `distalock bench imaging_gap`. "
        REPORT.write_text(head + text + "\n\n" + "\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    cv2.setNumThreads(1)
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 12))

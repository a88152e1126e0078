"""The smallest error that any unbiased method can have in a scene: the Cramér-Rao limit with texture.

Known to the limit, as they are to a perfect method: parts, C-arm, guide, where the balls are, noise, and the spectra of
the background. Unknown: the nail's pose (6), the radii of holes and nail, the chamfers, the metal's attenuation, the
blur (3), a floor that varies linearly, the display's curve (3) and edge enhancement (2); those with a width in
`PRIORS` are known to that width, as they are to our own fit. The background is a random field that multiplies the
signal: trabecular texture with the spectrum that the renderer has (measured on renders of the same bone with other
texture and without metal), and soft tissue and bone as a smooth field of 20 % and 12 mm.

With the derivatives J of the expected signal (differences of renders) and the covariance C of noise and background, the
information is J' C⁻¹ J. A pixel at an edge is rendered from a few samples of its area and of the focal spot, so J has
an error, and J' C⁻¹ J would count the error's square as information: a limit too low. So J is rendered twice, from
samples that have nothing in common, and the information is the symmetric part of J₁' C⁻¹ J₂, whose mean is without
this bias whatever the number of samples.

C has the quanta and the texture, both correlated by the detector's blur, white noise, and the rounding of the grey
values. Taken to be so: over the few pixels of the blur, brightness changes the size of noise and texture, not their
correlation; the two holes' backgrounds are independent; only pixels within 3 mm of a hole count.

usage: distalock bench cramer_rao [--seed N] [--samples N]   (what the limit is made of, in one of the random scenes)
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.linalg import cho_factor, cho_solve

from benchmarks.limits.cramer_rao_crop import SAMPLES
from benchmarks.limits.cramer_rao_images import SceneImages, scene_images
from benchmarks.scenes.random_scenes import scene_of_seed
from distalock.arguments import OneLineParser, seed_number
from shared.geometry.parts import Hole, NailPart, hole_surface_points
from simulation.scenario.values import Scenario

Floats = NDArray[np.float64]
SEED = 5003
SMOOTH_SHARE, _SMOOTH_MM = 0.2, 12.0
_KNOWN = 1e12
_COUNTS = tuple(2**k for k in range(4, 11))


@dataclass(frozen=True, slots=True)
class AxisLimit:
    """Smallest rms error of one hole's axis (degrees) and of its entry point across the axis (mm)."""

    hole_id: str
    axis_deg: float
    entry_mm: float


def axis_limits(scenario: Scenario) -> tuple[AxisLimit, ...]:
    """Limits of all holes in the scene's first image."""
    return limits_of(scene_images(scenario), scenario.parts.nail)


def limits_of(images: SceneImages, nail: NailPart, smooth_share: float = SMOOTH_SHARE) -> tuple[AxisLimit, ...]:
    """Limits of all holes, from what shaped the image; `smooth_share` is the size of the background's smooth field."""
    of_pose = _inverse(_information(images, smooth_share), images.scenario.seed)[:6, :6]
    return tuple(_limit(nail, hole, of_pose) for hole in nail.holes)


def _information(images: SceneImages, smooth_share: float) -> Floats:
    """What is known beforehand and what the counted pixels tell, shape (6 + P, 6 + P)."""
    information = np.diag(images.prior_precision)
    for counted in images.counted:
        one, other = images.derivatives[:, :, counted]
        covariance = pixel_covariance(images, counted, smooth_share)
        factor = cho_factor(covariance, lower=True, overwrite_a=True, check_finite=False)
        told = one @ cho_solve(factor, other.T, check_finite=False)
        information += 0.5 * (told + told.T)
    return information


def _inverse(information: Floats, seed: int) -> Floats:
    """Refused unless every direction has some information, which that of two sets need not have."""
    scale = np.sqrt(np.abs(np.diag(information)))
    least = float(np.linalg.eigvalsh(information / scale / scale[:, None])[0])
    if not least > 0.0:
        raise ValueError(
            f"the least eigenvalue of the information in the scene of seed {seed} is {least:.2g}, with 1 on the "
            "diagonal, and must be above 0: its two sets of rays differ by too much; "
            f"trace more (SAMPLES in cramer_rao_crop.py, now {SAMPLES})"
        )
    return np.asarray(np.linalg.inv(information), dtype=np.float64)


def _limit(nail: NailPart, hole: Hole, covariance: Floats) -> AxisLimit:
    """From the covariance of a small motion (rad, mm) of the nail in its own frame."""
    direction = hole.axis.direction
    across = np.linalg.svd(direction[None])[2][1:]
    entry, _ = hole_surface_points(nail, hole)
    turned = across @ np.hstack([-_cross(direction), np.zeros((3, 3))])
    moved = across @ np.hstack([-_cross(entry), np.eye(3)])
    axis, place = (float(np.sqrt(np.trace(J @ covariance @ J.T))) for J in (turned, moved))
    return AxisLimit(hole.id, float(np.degrees(axis)), place)


def _cross(v: Floats) -> Floats:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def pixel_covariance(images: SceneImages, counted: NDArray[np.bool_], smooth_share: float) -> Floats:
    """Of the signal at the counted pixels, shape (N, N)."""
    shape = (2 * counted.shape[0], 2 * counted.shape[1])
    blur2 = images.blur_transfer(shape) ** 2
    smooth = _smooth_spectrum(shape, _SMOOTH_MM * images.px_per_mm) * smooth_share**2
    background = _spectrum(images.texture_samples, shape) + smooth
    rows, columns = np.nonzero(counted)
    lag = (np.mod(rows[:, None] - rows, shape[0]), np.mod(columns[:, None] - columns, shape[1]))
    deviation, gain = np.sqrt(images.quanta[counted]), images.gain[counted]
    covariance = fft.irfft2(blur2, shape)[lag] * deviation[:, None] * deviation
    covariance += fft.irfft2(background * blur2, shape)[lag] * gain[:, None] * gain
    covariance[np.diag_indices(len(rows))] += images.white[counted]
    return np.asarray(covariance)


def _spectrum(samples: Floats, shape: tuple[int, int]) -> Floats:
    """Power spectrum of fields, shape (S, rows, columns), from their tapered transforms."""
    rows, columns = samples.shape[1:]
    taper = np.hanning(rows + 2)[1:-1, None] * np.hanning(columns + 2)[None, 1:-1]
    power = np.mean(np.abs(fft.rfft2(samples * taper, shape, axes=(1, 2))) ** 2, axis=0)
    return np.asarray(power / np.sum(taper**2))


def _smooth_spectrum(shape: tuple[int, int], length_px: float) -> Floats:
    """Power spectrum of a field of unit variance with the correlation exp(-d²/2l²)."""
    frequency2 = np.fft.fftfreq(shape[0])[:, None] ** 2 + np.fft.rfftfreq(shape[1])[None, :] ** 2
    power = np.exp(-2.0 * (np.pi * length_px) ** 2 * frequency2)
    return np.asarray(power / fft.irfft2(power, shape)[0, 0])


def _cases(images: SceneImages) -> Iterator[tuple[str, SceneImages, float]]:
    """Name of a case, what shapes the image in it, and the size of the background's smooth field."""
    yield "as it is", images, SMOOTH_SHARE
    same_twice = replace(images, derivatives=images.derivatives[[0, 0]])
    yield "with the rays' noise taken for information", same_twice, SMOOTH_SHARE
    plain = replace(images, texture_samples=1e-3 * images.texture_samples)
    yield "without texture", plain, SMOOTH_SHARE
    yield "on a flat background", plain, 1e-3
    shapes, all_else = images.prior_precision.copy(), images.prior_precision.copy()
    shapes[6:9], all_else[6:] = _KNOWN, _KNOWN
    yield "radii and chamfers known", replace(images, prior_precision=shapes), SMOOTH_SHARE
    yield "all but the pose known", replace(images, prior_precision=all_else), SMOOTH_SHARE


def main(arguments: Sequence[str] = ()) -> int:
    """Print the limit in one scene, and what it would be if more were known."""
    parser = OneLineParser(prog="distalock bench cramer_rao", description="the limit in one of the random scenes")
    parser.add_argument("--seed", type=seed_number, default=SEED, help=f"seed of the scene ({SEED})")
    more = "rays in each of an edge pixel's two sets"
    parser.add_argument("--samples", type=int, choices=_COUNTS, default=SAMPLES, help=f"{more} ({SAMPLES})")
    given = parser.parse_args(list(arguments))
    scenario = scene_of_seed(given.seed)
    images, nail = scene_images(scenario, given.samples), scenario.parts.nail
    texture = 100.0 * float(images.texture_samples[:, images.counted.any(axis=0)].std())
    dose = scenario.exposure.photons_per_px
    print(f"scene {given.seed}: {nail.material}, {dose:.0f} quanta a pixel, texture {texture:.1f} % of the background")
    for name, known, smooth_share in _cases(images):
        limits = limits_of(known, nail, smooth_share)
        print(f"| {name} | {max(limit.axis_deg for limit in limits):.4f}° |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

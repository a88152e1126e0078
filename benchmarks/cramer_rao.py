"""The smallest error that any unbiased method can have in a scene: the Cramér-Rao limit with texture.

Known to the limit, as they are to a perfect method: parts, C-arm, guide, where the balls are, noise, and the spectra of
the background. Unknown: the nail's pose (6), the radii of holes and nail, the chamfers, the metal's attenuation, the
blur, a floor that varies linearly, the display's curve (3) and edge enhancement (2); those with a width in `PRIORS` are
known to that width, as they are to our own fit. The background is a random field that multiplies the signal:
trabecular texture with the spectrum that the renderer has (measured on renders of the same bone with other texture and
without metal), and soft tissue and bone as a smooth field of 20 % and 12 mm.

With the derivatives J of the expected signal (differences of renders) and the covariance C of noise and background, the
information is J' C⁻¹ J. C has the quanta and the texture, both correlated by the detector's blur, white noise, and the
rounding of the grey values. Taken to be so: over the few pixels of the blur, brightness changes the size of noise and
texture, not their correlation; the two holes' backgrounds are independent; only pixels within 3 mm of a hole count.

usage: distalock bench cramer_rao [--seed N]   (what the limit is made of, in one of the random scenes)
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.linalg import cho_factor, cho_solve

from benchmarks.cramer_rao_images import SceneImages, scene_images
from distalock.arguments import OneLineParser, seed_number
from shared.geometry.parts import Hole, NailPart, hole_surface_points
from simulation.scenario.values import Scenario

Floats = NDArray[np.float64]
SEED = 5003
SMOOTH_SHARE, _SMOOTH_MM = 0.2, 12.0
_KNOWN = 1e12


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
    information = np.diag(images.prior_precision)
    for counted in images.counted:
        columns = images.derivatives[:, counted]
        covariance = pixel_covariance(images, counted, smooth_share)
        factor = cho_factor(covariance, lower=True, overwrite_a=True, check_finite=False)
        information += columns @ cho_solve(factor, columns.T, check_finite=False)
    of_pose = np.asarray(np.linalg.inv(information), dtype=np.float64)[:6, :6]
    return tuple(_limit(nail, hole, of_pose) for hole in nail.holes)


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


def main(arguments: Sequence[str] = ()) -> int:
    """Print the limit in one scene, and what it would be if more were known."""
    from benchmarks.random_scenes import scene_of_seed  # which needs this module

    parser = OneLineParser(prog="distalock bench cramer_rao", description="the limit in one of the random scenes")
    parser.add_argument("--seed", type=seed_number, default=SEED, help=f"seed of the scene ({SEED})")
    seed = parser.parse_args(list(arguments)).seed
    scenario = scene_of_seed(seed)
    images, nail = scene_images(scenario), scenario.parts.nail
    plain = replace(images, texture_samples=1e-3 * images.texture_samples)
    shapes, all_else = images.prior_precision.copy(), images.prior_precision.copy()
    shapes[6:9], all_else[6:] = _KNOWN, _KNOWN
    texture = float(images.texture_samples[:, images.counted.any(axis=0)].std())
    dose = scenario.exposure.photons_per_px
    print(
        f"scene {seed}: {nail.material}, {dose:.0f} quanta a pixel, texture {100.0 * texture:.1f} % of the background"
    )
    for name, limits in (
        ("as it is", limits_of(images, nail)),
        ("without texture", limits_of(plain, nail)),
        ("on a flat background", limits_of(plain, nail, 1e-3)),
        ("radii and chamfers known", limits_of(replace(images, prior_precision=shapes), nail)),
        ("all but the pose known", limits_of(replace(images, prior_precision=all_else), nail)),
    ):
        print(f"| {name} | {max(limit.axis_deg for limit in limits):.4f}° |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

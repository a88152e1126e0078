"""Calibration against its peers and its limit: `distalock bench imaging_calibration [IMAGES]`.

Images of the shipped ring with 72 of its 120 balls left, lost at random or in one patch, at a contrast-to-noise ratio
of 15. The distortion is a random polynomial of order 5, or pincushion of tangents, swirl and waves, which no polynomial
fits. Everyone gets the same measured centres. Errors are those of rays through the true images of points at the heights
of nail and guide, in pixels of those points. The table goes to docs/benchmarks/calibration.md.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.baselines.calibration_peers import OPENCV_MODELS, Rays, joint, opencv, sequential
from benchmarks.common.places import PAGES
from benchmarks.imaging.scenes import (
    GUIDE_MM,
    NAIL_MM,
    PX_PER_MM,
    CArm,
    Distortion,
    Exposure,
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
from benchmarks.limits.balls_and_rays import centre_variance_px2, ray_deviation_px
from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from shared.errors import Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import RingPart

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Method = Callable[[Array, Array, Array], Rays]

CONTRAST_TO_NOISE = 15.0
# Of twelve images the rms is known to a tenth, for which balls are lost where matters: a few images make most of it.
USUAL_IMAGES = 48
REPORT = PAGES / "calibration.md"
METHODS: dict[str, Method] = {
    **{name: partial(opencv, flags) for name, flags in OPENCV_MODELS.items()},
    **{f"polynomial {order}, plate by plate": partial(sequential, order) for order in (3, 4, 5)},
    **{f"polynomial {order}, jointly": partial(joint, order) for order in (3, 5, 7)},
}


def targets() -> Array:
    """Points where nail and guide may be, shape (N, 3)."""
    x, y = np.meshgrid(np.linspace(-40.0, 40.0, 9), np.linspace(-40.0, 40.0, 9))
    flat = np.column_stack([x.ravel(), y.ravel()])
    return np.concatenate([np.column_stack([flat, np.full(len(flat), z)]) for z in (NAIL_MM, GUIDE_MM)])


def ray_errors_px(rays: Rays, points_mm: Array, c_arm: CArm) -> Array:
    """By how much rays miss points, shape (N,), in pixels of those points."""
    reach = (points_mm[:, 2] - rays.source_mm[2]) / rays.directions[:, 2]
    there = rays.source_mm[:2] + rays.directions[:, :2] * reach[:, None]
    magnification = -c_arm.source_mm[2] / (points_mm[:, 2] - c_arm.source_mm[2])
    return np.asarray(np.hypot(*(there - points_mm[:, :2]).T) / np.sqrt(2.0) * PX_PER_MM * magnification)


def ours(calibration: CArmCalibration, at_px: Array) -> Rays:
    ring_from_camera = calibration.camera_from_ring.inverse()
    return Rays(ring_from_camera.translation_mm, calibration.rays_camera(at_px) @ ring_from_camera.rotation.T)


@dataclass(slots=True)
class Tally:
    """What is gathered over images of one kind."""

    rays_px: dict[str, list[Array]] = field(default_factory=dict)
    source_mm: dict[str, list[Array]] = field(default_factory=dict)
    limit_px: list[Array] = field(default_factory=list)
    field_normalised: list[Array] = field(default_factory=list)
    source_normalised: list[Array] = field(default_factory=list)
    refused: int = 0

    def add(self, name: str, rays: Rays, points: Array, c_arm: CArm) -> None:
        """Errors of one method on one image."""
        self.rays_px.setdefault(name, []).append(ray_errors_px(rays, points, c_arm))
        self.source_mm.setdefault(name, []).append(rays.source_mm - c_arm.source_mm)


def one_image(seed: int, distortion: Distortion, lost: str, ring: RingPart, tally: Tally) -> None:
    rng = np.random.default_rng([seed, len(lost), len(distortion)])
    c_arm = random_c_arm(rng, distortion)
    present = left_over(ring, lost, rng)
    shadow, light = ring_shadow(c_arm, ring).select(present), patient(rng)
    noise = noise_of(CONTRAST_TO_NOISE, light, shadow)
    pixels = exposed(displayed(light * transmission(shadow)), Exposure(noise), rng)
    outcome = calibrate_image(pixels, ring, NominalGeometry())
    if isinstance(outcome, Rejected):
        tally.refused += 1
        return
    calibration = outcome.value
    named = calibration.balls.ring_index >= 0
    index, measured = calibration.balls.ring_index[named], calibration.balls.centre_px[named]
    points = targets()
    at_px = c_arm.image(points)
    tally.add("distalock", ours(calibration, at_px), points, c_arm)
    for name, method in METHODS.items():
        tally.add(name, method(ring.balls.position_mm[index], measured, at_px), points, c_arm)
    _add_normalised(calibration, c_arm, tally)
    if distortion is Distortion.QUINTIC:
        deviation = np.full(len(ring.balls), np.nan)
        for k, ball in enumerate(np.flatnonzero(present)):
            deviation[ball] = np.sqrt(centre_variance_px2(shadow, k, light, noise))
        seen = np.zeros(len(ring.balls), bool)
        seen[index] = present[index]
        tally.limit_px.append(ray_deviation_px(c_arm, ring, seen, deviation, points))


def _add_normalised(calibration: CArmCalibration, c_arm: CArm, tally: Tally) -> None:
    """Errors of focal spot and distortion over the predicted ones."""
    error = calibration.camera_from_ring.inverse().translation_mm - c_arm.source_mm
    tally.source_normalised.append(error / np.sqrt(np.diag(calibration.source_covariance_mm2)))
    x, y = np.meshgrid(np.linspace(-85.0, 85.0, 13), np.linspace(-85.0, 85.0, 13))
    plane = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    at_px = c_arm.image(plane[np.hypot(*plane[:, :2].T) < 95.0])
    ideal = calibration.camera.project(calibration.camera_from_ring.points(plane[np.hypot(*plane[:, :2].T) < 95.0]))
    deviation = calibration.distortion.standard_deviation_at(at_px)
    tally.field_normalised.append((calibration.distortion.undistort(at_px) - ideal) / deviation[:, None])


def rms(values: list[Array]) -> float:
    return float(np.sqrt(np.mean(np.square(np.concatenate([v.ravel() for v in values])))))


def rows(title: str, tally: Tally) -> list[str]:
    lines = []
    for name, errors in tally.rays_px.items():
        worst = max(rms([e]) for e in errors)
        source = np.sqrt(np.mean(np.square(tally.source_mm[name]), axis=0))
        lines.append(
            f"| {title} | {name} | {rms(errors):.3f} | {worst:.3f} | {np.hypot(*source[:2]):.2f} | {source[2]:.2f} |"
        )
    if tally.limit_px:
        lines.append(f"| {title} | *Cramér-Rao limit, order known* | {rms(tally.limit_px):.3f} | | | |")
    return lines


def main(images: int = USUAL_IMAGES) -> int:
    ring = shipped_ring()
    table = ["| distortion, balls lost | | rays, rms px | worst image | source, mm across | along |", "|" + "---|" * 6]
    honest = ["| distortion, balls lost | refused | field, error / predicted | source |", "|" + "---|" * 4]
    for distortion in (Distortion.QUINTIC, Distortion.FREE):
        for lost in ("random", "patch"):
            tally = Tally()
            for seed in range(images):
                one_image(seed, distortion, lost, ring, tally)
            title = f"{distortion}, {lost}"
            table += rows(title, tally)
            honest.append(
                f"| {title} | {tally.refused} of {images} | {rms(tally.field_normalised):.2f} "
                f"| {rms(tally.source_normalised):.2f} |"
            )
            print("\n".join([*rows(title, tally), honest[-1]]), flush=True)
    if images >= USUAL_IMAGES:
        REPORT.write_text(_document(table, honest, images))
    return 0


def _document(table: list[str], honest: list[str], images: int) -> str:
    return f"""# Calibration

Made by `distalock bench imaging_calibration`: {images} images a kind, seeded. 72 of the ring's 120 balls are left,
the rest lost at random or in one patch; contrast-to-noise ratio 15 of the middle ball; own images (spheres, display
curve, a leg). All methods get the centres that distalock measured and named; OpenCV starts at the true focal length
within 8 %. Errors are per axis, of rays through the true images of points at the height of nail and guide, within
40 mm of the middle each way.

{chr(10).join(table)}

Consistency of the covariance (1 is perfect), over the ring's whole plane and the focal spot:

{chr(10).join(honest)}
"""


if __name__ == "__main__":
    cv2.setNumThreads(1)
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else USUAL_IMAGES))

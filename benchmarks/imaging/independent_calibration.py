"""Calibrate independent X-ray images with known truth: `python -m benchmarks.imaging.independent_calibration [FOLDER]`.

The folder is that of the independent images (by default the one that DISTALOCK_FLUOROSCOPY names, or
../shared/fluoroscopy). Printed are, per image: balls found, error of the focal spot and that error over its prediction,
where rays through true pixels pass the truth at the height of the nail, and by how much the direction from guide to
nail turns.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.data.independent_images import ListedImage, Truth, independent_folder, listed_images
from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from shared.errors import Rejected
from shared.geometry.calibration import CArmCalibration
from shared.parts.files import ring_from_json

Array = NDArray[np.float64]

NAIL_MM, GUIDE_MM = -240.0, -345.0
CENTRAL_PX = 220.0


@dataclass(frozen=True, slots=True)
class Row:
    """What came out for one image; `refusal` is empty when it was calibrated."""

    image: str
    refusal: str
    balls_found: int
    source_error_mm: Array
    source_normalised: Array
    nail_error_mm: Array
    axis_error_deg: Array
    seconds: float


def calibrate(image: ListedImage) -> Row:
    """Calibrate one image and compare with its truth."""
    ring = ring_from_json(image.ring.read_bytes())
    pixels = cv2.imread(str(image.path), cv2.IMREAD_UNCHANGED)
    assert pixels is not None
    nominal = NominalGeometry(**image.entry.nominal.model_dump())
    started = time.process_time()
    outcome = calibrate_image(pixels.astype(np.float32), ring, nominal)
    seconds = time.process_time() - started
    if isinstance(outcome, Rejected):
        nothing = np.zeros(0)
        return Row(image.name, outcome.reasons[0].code, 0, nothing, nothing, nothing, nothing, seconds)
    return _compared(outcome.value, image, ring.balls.position_mm, seconds)


def _compared(calibration: CArmCalibration, image: ListedImage, balls_mm: Array, seconds: float) -> Row:
    truth = image.truth()
    pose = np.array(truth.camera_from_ring)
    source = -pose[:3, :3].T @ pose[:3, 3]
    estimated = calibration.camera_from_ring.inverse().translation_mm
    error = estimated - source
    pixel = _displayed(truth, image, calibration)
    inside = np.hypot(*(pixel - 0.5 * (calibration.width_px - 1)).T) < CENTRAL_PX
    rays = calibration.rays_camera(pixel[inside]) @ calibration.camera_from_ring.rotation
    true_rays = balls_mm[inside] - source
    at_nail = _at(estimated, rays, NAIL_MM) - _at(source, true_rays, NAIL_MM)
    at_guide = _at(estimated, rays, GUIDE_MM) - _at(source, true_rays, GUIDE_MM)
    return Row(
        image=image.name,
        refusal="",
        balls_found=calibration.balls_found,
        source_error_mm=error,
        source_normalised=error / np.sqrt(np.diag(calibration.source_covariance_mm2)),
        nail_error_mm=np.hypot(*at_nail.T),
        axis_error_deg=np.degrees(np.hypot(*(at_guide - at_nail).T) / (NAIL_MM - GUIDE_MM)),
        seconds=seconds,
    )


def _displayed(truth: Truth, image: ListedImage, calibration: CArmCalibration) -> Array:
    """True pixels of the ring's balls in the un-mirrored image as received, shape (N, 2)."""
    x, y = np.array([ball.image_px for ball in truth.balls if ball.id.startswith("R")]).T
    display = image.entry.display
    last = calibration.width_px - 1
    x = last - x if display.flip else x
    for _ in range(display.rot90):
        x, y = y, last - x
    return np.stack([last - x if calibration.mirrored else x, y], axis=1)


def _at(source: Array, rays: Array, z_mm: float) -> Array:
    """Where rays, shape (N, 3), from a source meet a plane of the ring's frame, shape (N, 2)."""
    return np.asarray(source[:2] + rays[:, :2] * ((z_mm - source[2]) / rays[:, 2])[:, None])


def main(folder: Path | None = None) -> int:
    folder = folder or independent_folder()
    if folder is None:
        print("calibration: left out, there is no folder of independent images; set DISTALOCK_FLUOROSCOPY to one")
        return 0
    rows = []
    print("image      balls  source error mm       normalised          nail mm  axis deg  CPU s")
    for image in listed_images(folder):
        row = calibrate(image)
        rows.append(row)
        if row.refusal:
            print(f"{row.image:10} refused: {row.refusal}")
            continue
        error, normalised = (
            " ".join(f"{v:+6.2f}" for v in values) for values in (row.source_error_mm, row.source_normalised)
        )
        print(
            f"{row.image:10} {row.balls_found:5d}  {error}  {normalised}  {row.nail_error_mm.mean():7.4f}"
            f"  {row.axis_error_deg.mean():8.4f}  {row.seconds:5.2f}",
            flush=True,
        )
    _summary([r for r in rows if not r.refusal], len(rows))
    return 0


def _summary(good: list[Row], images: int) -> None:
    def rms(values: list[Array]) -> str:
        return " ".join(f"{v:.2f}" for v in np.sqrt(np.mean(np.square(values), axis=0)))

    print(f"{len(good)} of {images} calibrated; source rms {rms([r.source_error_mm for r in good])} mm, ", end="")
    print(f"normalised rms {rms([r.source_normalised for r in good])}; nail ", end="")
    print(f"{np.mean([r.nail_error_mm.mean() for r in good]):.4f} mm, axis ", end="")
    print(f"{np.mean([r.axis_error_deg.mean() for r in good]):.4f} deg, ", end="")
    print(f"median {np.median([r.seconds for r in good]):.2f} s of CPU")


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else None))

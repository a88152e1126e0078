"""How fast, and whether memory grows: `distalock bench live_mode [IMAGES]`.

Images of 1024 x 1024 pixels of a C-arm that stands still and moves now and then, as fluoroscopy shows them. Each is
calibrated by itself, or with the one before it in mind, as the imaging service does. Times are those of one process,
beside OpenCV's HoughCircles on the same images (which only looks for circles) as a measure of the machine. Memory is
the process's resident set after every two hundred images.
"""

import sys
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.common.places import PAGES
from benchmarks.imaging.scenes import (
    Distortion,
    Exposure,
    displayed,
    exposed,
    noise_of,
    patient,
    random_c_arm,
    ring_shadow,
    shipped_ring,
    transmission,
)
from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_tracking import calibrate_next
from shared.errors import Accepted
from shared.geometry.calibration import CArmCalibration

FloatImage = NDArray[np.float32]

VIEWS, EACH = 3, 12
REPORT_EVERY = 200
REPORT = PAGES / "live-mode.md"


def film() -> list[FloatImage]:
    """Some views, several noisy frames of each, in order."""
    ring, frames = shipped_ring(), []
    for view in range(VIEWS):
        rng = np.random.default_rng([7, view])
        shadow, light = ring_shadow(random_c_arm(rng, Distortion.FREE), ring), patient(rng)
        grey = displayed(light * transmission(shadow))
        exposure = Exposure(noise_of(15.0, light, shadow), noise_blur_px=0.7)
        frames += [exposed(grey, exposure, rng) for _ in range(EACH)]
    return frames


def circles(pixels: FloatImage) -> None:
    image = cv2.GaussianBlur((pixels / 256.0).astype(np.uint8), (0, 0), 1.0)
    cv2.HoughCircles(image, cv2.HOUGH_GRADIENT, 1, 5.0, param1=120, param2=9, minRadius=3, maxRadius=9)


def resident_mib() -> float:
    """Resident set of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**20


def main(images: int = 2000) -> int:
    cv2.setNumThreads(1)
    ring, nominal, frames = shipped_ring(), NominalGeometry(), film()
    alone, following, peer, memory = [], [], [], []
    before: CArmCalibration | None = None
    calibrate_image(frames[0], ring, nominal)  # compiles
    refused = 0
    for number in range(images):
        pixels = frames[number % len(frames)]
        started = time.process_time()
        outcome = calibrate_next(pixels, ring, nominal, before)
        following.append(time.process_time() - started)
        if isinstance(outcome, Accepted):
            before = outcome.value
        else:
            refused += 1
        if number < 3 * len(frames):
            started = time.process_time()
            calibrate_image(pixels, ring, nominal)
            alone.append(time.process_time() - started)
            started = time.process_time()
            circles(pixels)
            peer.append(time.process_time() - started)
        if number % REPORT_EVERY == REPORT_EVERY - 1:
            memory.append(resident_mib())
    milliseconds = {
        "by itself": 1e3 * float(np.median(alone)),
        "after one of the same view": 1e3 * float(np.median(following)),
        "HoughCircles": 1e3 * float(np.median(peer)),
    }
    lines = ["| | ms, median | of HoughCircles |", "|---|---|---|"]
    lines += [f"| {k} | {v:.0f} | {v / milliseconds['HoughCircles']:.1f} |" for k, v in milliseconds.items()]
    growth = memory[-1] - memory[len(memory) // 2] if len(memory) > 1 else 0.0
    speed, every = images / sum(following), ", ".join(f"{m:.1f}" for m in memory)
    lines.append("")
    lines.append(f"{images} images, {refused} refused, {speed:.1f} images/s; another view every {EACH} images.")
    lines.append(
        f"Resident memory after every {REPORT_EVERY} images, MiB: {every}; the second half added {growth:+.1f}."
    )
    print("\n".join(lines))
    if images >= 2000:
        text = (__doc__ or "").split("\n", 2)[2].strip()
        REPORT.write_text(f"# Live mode\n\nMade by `distalock bench live_mode`. {text}\n\n" + "\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 2000))

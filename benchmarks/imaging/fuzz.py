"""Damaged input: `distalock bench imaging_fuzz [FILES] [IMAGES]`.

Files: valid DICOM objects (plain, RLE, runs) and PNGs with bytes changed, removed, doubled and cut; each must be read
as an image or refused as unreadable, whatever is in it. Images: a calibrated image with parts overwritten, turned,
inverted, torn, blurred, saturated; each must be refused, or calibrated as well as the undamaged one.
"""

import logging
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.common.places import PAGES
from benchmarks.imaging.scenes import (
    NAIL_MM,
    CArm,
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
from services.imaging.devices.dicom_file import dicom_of_pixels
from services.imaging.devices.image_file import read_image
from services.imaging.devices.received_image import ReceivedImage
from shared.errors import Accepted, ImageUnreadable
from shared.geometry.calibration import CArmCalibration

FloatImage = NDArray[np.float32]
Array = NDArray[np.float64]

SLOW_S = 20.0
# A ray at the nail that is off by more than this would matter; undamaged images stay far below.
NONSENSE_MM = 0.3
REPORT = PAGES / "fuzz.md"


def seeds() -> list[bytes]:
    """Files to be damaged."""
    rng = np.random.default_rng(0)
    pixels = rng.integers(0, 4000, (48, 64)).astype(np.uint16)
    png = cv2.imencode(".png", pixels)[1].tobytes()
    tiff = cv2.imencode(".tiff", pixels)[1].tobytes()
    return [dicom_of_pixels(pixels)[0], *_compressed_and_run(pixels), png, tiff]


def _compressed_and_run(pixels: NDArray[np.uint16]) -> list[bytes]:
    from io import BytesIO

    from pydicom import dcmread, dcmwrite
    from pydicom.uid import RLELossless

    files = []
    for kind in ("rle", "run"):
        dataset = dcmread(BytesIO(dicom_of_pixels(pixels)[0]))
        if kind == "rle":
            dataset.compress(RLELossless)
        else:
            dataset.NumberOfFrames, dataset.PixelData = 4, pixels.tobytes() * 4
        buffer = BytesIO()
        dcmwrite(buffer, dataset, enforce_file_format=True)
        files.append(buffer.getvalue())
    return files


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """One to eight changes: bytes, blocks, lengths; most of them in the header."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 9))):
        header = rng.random() < 0.7
        at = int(rng.integers(0, max(1, min(len(data), 1200 if header else len(data)))))
        length = int(rng.integers(1, 24))
        match int(rng.integers(0, 5)):
            case 0:
                data[at : at + 1] = bytes([int(rng.integers(0, 256))])
            case 1:
                data[at : at + length] = rng.bytes(length)
            case 2:
                del data[at : at + length]
            case 3:
                data[at:at] = data[at : at + length]
            case _:
                data[at : at + 4] = int(rng.choice([0, 1, 255, 65535, 2**31 - 1, 2**32 - 1])).to_bytes(4, "little")
    return bytes(data[: int(rng.integers(1, len(data)))] if rng.random() < 0.1 else data)


def fuzz_files(count: int) -> Counter[str]:
    """Outcomes of reading damaged files; a key that begins with `!` is a failure."""
    outcomes: Counter[str] = Counter()
    originals = seeds()
    for number in range(count):
        rng = np.random.default_rng([1, number])
        content = mutated(originals[number % len(originals)], rng)
        started = time.perf_counter()
        try:
            image = read_image(content, "fuzz")
            outcomes["read" if publishable(image) else f"! shape {image.pixels.shape}, {image.bits_stored} bits"] += 1
        except ImageUnreadable:
            outcomes["refused"] += 1
        except Exception as error:  # noqa: BLE001 - this is what is looked for
            outcomes[f"! {type(error).__name__}: {str(error)[:60]} (seed {number})"] += 1
        if time.perf_counter() - started > SLOW_S:
            outcomes[f"! slow (seed {number})"] += 1
    return outcomes


def publishable(image: ReceivedImage) -> bool:
    """Whether an image is what the services are told it is."""
    pixels = image.pixels
    sides = pixels.ndim == 2 and min(pixels.shape) > 0 and max(pixels.shape) <= 8192
    return sides and pixels.dtype == np.float32 and bool(np.isfinite(pixels).all()) and 0 < image.bits_stored <= 16


def spoiled(pixels: FloatImage, rng: np.random.Generator) -> FloatImage:
    """One to three harms that a receiver or a person may do to an image."""
    for _ in range(int(rng.integers(1, 4))):
        harm: Callable[[FloatImage, np.random.Generator], FloatImage] = HARMS[int(rng.integers(0, len(HARMS)))]
        pixels = harm(pixels, rng)
    return np.ascontiguousarray(pixels, dtype=np.float32)


def _box(pixels: FloatImage, rng: np.random.Generator) -> tuple[slice, slice]:
    rows, columns = pixels.shape
    top, left = int(rng.integers(0, rows - 8)), int(rng.integers(0, columns - 8))
    return (
        slice(top, top + int(rng.integers(8, rows // 2 + 9))),
        slice(left, left + int(rng.integers(8, columns // 2 + 9))),
    )


def _covered(pixels: FloatImage, rng: np.random.Generator) -> FloatImage:
    out = pixels.copy()
    out[_box(pixels, rng)] = rng.choice([0.0, 65535.0, float(pixels.mean())])
    return out


def _noisy_box(pixels: FloatImage, rng: np.random.Generator) -> FloatImage:
    out, box = pixels.copy(), _box(pixels, rng)
    out[box] = rng.uniform(0.0, 65535.0, out[box].shape)
    return out


def _torn(pixels: FloatImage, rng: np.random.Generator) -> FloatImage:
    out, row = pixels.copy(), int(rng.integers(1, pixels.shape[0] - 1))
    out[row:] = np.roll(out[row:], int(rng.integers(2, 200)), axis=1)
    return out


def _copied(pixels: FloatImage, rng: np.random.Generator) -> FloatImage:
    """A part of the image appears twice: a picture in the picture."""
    out, (rows, columns) = pixels.copy(), _box(pixels, rng)
    part = pixels[rows, columns]
    top = int(rng.integers(0, pixels.shape[0] - part.shape[0] + 1))
    left = int(rng.integers(0, pixels.shape[1] - part.shape[1] + 1))
    out[top : top + part.shape[0], left : left + part.shape[1]] = part
    return out


def _stretched(pixels: FloatImage, rng: np.random.Generator) -> FloatImage:
    size = (int(pixels.shape[1] * rng.uniform(0.3, 1.2)), int(pixels.shape[0] * rng.uniform(0.3, 1.2)))
    return np.asarray(cv2.resize(pixels, (max(size[0], 16), max(size[1], 16))), dtype=np.float32)


HARMS: tuple[Callable[[FloatImage, np.random.Generator], FloatImage], ...] = (
    _covered,
    _noisy_box,
    _torn,
    _copied,
    _stretched,
    lambda p, _: np.asarray(p.max() - p),
    lambda p, rng: np.rot90(p, int(rng.integers(1, 4))),
    lambda p, _: p[:, ::-1],
    lambda p, rng: np.asarray(cv2.blur(p, (int(rng.integers(2, 20)), 1)), dtype=np.float32),
    lambda p, rng: np.minimum(p, np.float32(np.quantile(p, rng.uniform(0.1, 0.9)))),
    lambda p, rng: p + rng.normal(0.0, 6000.0, p.shape).astype(np.float32),
    lambda p, rng: p[: int(rng.integers(1, p.shape[0]) + 1)],
    lambda p, _: np.where(np.random.default_rng(0).random(p.shape) < 0.001, np.float32(np.nan), p),
    lambda p, _: np.zeros_like(p),
)


def nail_error_mm(calibration: CArmCalibration, c_arm: CArm) -> float:
    """How far apart the balls appear at the nail's height from where they should: nothing that turning changes."""
    source = calibration.camera_from_ring.inverse().translation_mm
    return float(np.linalg.norm((source - c_arm.source_mm) * np.array([1.0, 1.0, 0.05])) * abs(NAIL_MM) / 970.0)


def fuzz_images(count: int) -> Counter[str]:
    """Outcomes of calibrating spoiled images."""
    outcomes: Counter[str] = Counter()
    ring = shipped_ring()
    scenes = []
    for seed in range(4):
        rng = np.random.default_rng([2, seed])
        c_arm = random_c_arm(rng, Distortion.QUINTIC)
        light, shadow = patient(rng), ring_shadow(c_arm, ring)
        exposure = Exposure(noise_of(30.0, light, shadow))
        scenes.append((c_arm, exposed(displayed(light * transmission(shadow)), exposure, rng)))
    for number in range(count):
        rng = np.random.default_rng([3, number])
        c_arm, pixels = scenes[number % len(scenes)]
        harmed = spoiled(pixels, rng)
        started = time.perf_counter()
        try:
            outcome = calibrate_image(harmed, ring, NominalGeometry())
        except Exception as error:  # noqa: BLE001 - this is what is looked for
            outcomes[f"! {type(error).__name__}: {str(error)[:60]} (seed {number})"] += 1
            continue
        if time.perf_counter() - started > SLOW_S:
            outcomes[f"! slow (seed {number})"] += 1
        if not isinstance(outcome, Accepted):
            outcomes[f"refused: {outcome.reasons[0].code}"] += 1
        elif (error_mm := nail_error_mm(outcome.value, c_arm)) < NONSENSE_MM or harmed.shape != pixels.shape:
            outcomes["calibrated"] += 1
        else:
            outcomes[f"! off by {error_mm:.2f} mm at the nail (seed {number})"] += 1
    return outcomes


def main(files: int = 10_000, images: int = 1000) -> int:
    lines = [
        "# Damaged input",
        "",
        f"Made by `distalock bench imaging_fuzz`: {files} damaged files and {images} spoiled images, seeded.",
        "Lines that begin with `!` would be failures: exceptions, reading for longer than 20 s, nonsense accepted.",
        "",
        "| | outcome | count |",
        "|---|---|---|",
    ]
    failed = 0
    for name, outcomes in (("files", fuzz_files(files)), ("images", fuzz_images(images))):
        lines += [f"| {name} | {key} | {value} |" for key, value in outcomes.most_common()]
        failed += sum(value for key, value in outcomes.items() if key.startswith("!"))
    print("\n".join(lines[5:]))
    if files >= 10_000:
        REPORT.write_text("\n".join(lines) + "\n")
    return 1 if failed else 0


if __name__ == "__main__":
    # What libraries say of every damaged file would drown the table.
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    cv2.setNumThreads(1)
    sys.exit(main(*(int(a) for a in sys.argv[1:3])))

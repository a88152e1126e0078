"""`distalock calibrate ring|guide IMAGES...`: true places of the balls of a built part, as a measured part file."""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from distalock.arguments import EXIT_BAD_INPUT
from distalock.calibrate import LEAST_IMAGES, MOST_IMAGES
from distalock.image_files import ImageFile, read_image_file, require_different
from distalock.locate import NominalOptions, image_paths
from distalock.outputs import require_apart, write_whole
from distalock.part_calibration.displacements import Array, Displacements, rigid_motions, without
from distalock.part_calibration.guide_views import GuideView, guide_displacements, guide_view
from distalock.part_calibration.result import CalibrationImage, MeasuredBall, PartCalibration, measured_file
from distalock.part_calibration.ring_views import RingView, ring_displacements, ring_view
from services.imaging.core.calibration import calibrate_image
from services.registration.core.guide.locate import locate_guide
from services.registration.core.localise import unmirrored
from shared.errors import InputError, Rejected
from shared.geometry.parts import BallPattern, GuidePart, RingPart
from shared.messages.base import Vector3
from shared.parts.files import guide_from_json, read_part_file, ring_from_json

EXIT_ACCEPTED, EXIT_REJECTED = 0, 3
# Every fourth image checks the places that the others give.
_HELD_OUT_EVERY: Final = 4
_OUTLIER_SIGMAS: Final = 4.0

View = RingView | GuideView
Look = Callable[[ImageFile], View | str]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A part to calibrate: how an image shows it (or why not), and how images of it are solved."""

    kind: Literal["ring", "guide"]
    content: bytes
    sha256: str
    balls: BallPattern
    view: Look
    solve: Callable[[Sequence[View]], Displacements]


def run(given: argparse.Namespace) -> int:
    """Run `distalock calibrate`; returns the exit code: 0 accepted, 3 rejected, 2 bad input."""
    try:
        part = _part_of(given)
        paths = _images(given.images)
        if given.out is not None:
            require_apart(given.out, (*paths, getattr(given, part.kind)))
        files = tuple(read_image_file(path) for path in paths)
        require_different(files)
        calibration, measured = calibrated(part, files)
        if given.out is not None and calibration.verdict == "accepted":
            write_whole(given.out, measured)
    except InputError as error:
        print(f"distalock calibrate: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    print(calibration.model_dump_json(by_alias=True, indent=1))
    return EXIT_ACCEPTED if calibration.verdict == "accepted" else EXIT_REJECTED


def _images(places: Sequence[Path]) -> tuple[Path, ...]:
    paths = tuple(image_paths(places))
    if not LEAST_IMAGES <= len(paths) <= MOST_IMAGES:
        raise InputError(f"{len(paths)} images were given ({LEAST_IMAGES} to {MOST_IMAGES} needed); take as many")
    return paths


def _part_of(given: argparse.Namespace) -> Part:
    options = NominalOptions.of(given)
    ring_json = read_part_file(given.ring)
    ring = ring_from_json(ring_json, str(given.ring))
    if given.part == "ring":
        return _ring(ring_json, ring, options)
    guide_json = read_part_file(given.guide)
    return _guide(guide_json, guide_from_json(guide_json, str(given.guide)), ring, options)


def _ring(content: bytes, ring: RingPart, options: NominalOptions) -> Part:
    def view(file: ImageFile) -> View | str:
        pixels = options.pixels(file.content.pixels)
        found = calibrate_image(pixels, ring, options.geometry(file.content.acquisition))
        return found.reasons[0].message if isinstance(found, Rejected) else ring_view(found.value, ring, pixels)

    def solve(views: Sequence[View]) -> Displacements:
        return ring_displacements(tuple(one for one in views if isinstance(one, RingView)), ring)

    return Part("ring", content, ring.sha256, ring.balls, view, solve)


def _guide(content: bytes, guide: GuidePart, ring: RingPart, options: NominalOptions) -> Part:
    def view(file: ImageFile) -> View | str:
        pixels: NDArray[np.float32] = options.pixels(file.content.pixels)
        calibration = calibrate_image(pixels, ring, options.geometry(file.content.acquisition))
        if isinstance(calibration, Rejected):
            return calibration.reasons[0].message
        found = locate_guide(unmirrored(pixels, calibration.value), calibration.value, ring, guide)
        return (
            found.reasons[0].message
            if isinstance(found, Rejected)
            else guide_view(calibration.value, guide, found.value)
        )

    def solve(views: Sequence[View]) -> Displacements:
        return guide_displacements(tuple(one for one in views if isinstance(one, GuideView)), guide)

    return Part("guide", content, guide.sha256, guide.balls, view, solve)


def calibrated(part: Part, files: Sequence[ImageFile]) -> tuple[PartCalibration, bytes]:
    """The calibration of a part by images of it, and the measured part file."""
    looked = [(file.path, part.view(file)) for file in files]
    views = [(path, one) for path, one in looked if not isinstance(one, str)]
    if len(views) < LEAST_IMAGES:
        why = next((f"; {path.name}: {one}" for path, one in looked if isinstance(one, str)), "")
        raise InputError(f"{len(views)} of {len(files)} images could be used (at least {LEAST_IMAGES}){why}")
    held_out = {path for number, (path, _) in enumerate(views, 1) if number % _HELD_OUT_EVERY == 0}
    checked = _moved(part, part.solve([one for path, one in views if path not in held_out]))
    found = part.solve([one for _, one in views])
    images = tuple(_image(path, one, part, checked, held_out) for path, one in looked)
    checks = [one for one in images if one.role == "held_out"]
    before, after = _rms(one.rms_before_px for one in checks), _rms(one.rms_after_px for one in checks)
    reasons = () if after < before else (_no_better(before, after),)
    calibration, sd_mm, frame = _statistics(part, found, [one for _, one in views])
    message = PartCalibration(
        verdict="rejected" if reasons else "accepted",
        reasons=reasons,
        part=part.kind,
        part_sha256=part.sha256,
        spread_mm=found.spread_mm,
        frame_mm=None if frame is None else frame[0],
        frame_deg=None if frame is None else frame[1],
        held_out_rms_before_px=before,
        held_out_rms_after_px=after,
        outliers=tuple(ball.id for ball in calibration if ball.outlier),
        images=images,
        balls=calibration,
    )
    return message, measured_file(part.content, _in_space(found.mean_mm), sd_mm, frame)


def _rms(values: Iterable[float | None]) -> float:
    return float(np.sqrt(np.mean([value**2 for value in values if value is not None])))


def _no_better(before_px: float, after_px: float) -> str:
    return (
        f"in images held out the balls' residual is {after_px:.3f} px with the measured places (limit "
        f"{before_px:.3f} px, that with the file's); the part is as filed, or take more images from more directions"
    )


def _in_space(displacement_mm: Array) -> Array:
    """Displacements along three axes, shape (B, 3); none along the beam where it was not estimated."""
    return np.pad(displacement_mm, ((0, 0), (0, 3 - displacement_mm.shape[1])))


def _moved(part: Part, found: Displacements) -> Array:
    return np.asarray(part.balls.position_mm + _in_space(found.mean_mm))


def _image(path: Path, view: View | str, part: Part, checked_mm: Array, held_out: set[Path]) -> CalibrationImage:
    if isinstance(view, str):
        return CalibrationImage(image_file=str(path), role="left_out", why=view)
    return CalibrationImage(
        image_file=str(path),
        role="held_out" if path in held_out else "fitted",
        rms_before_px=view.rms_px(part.balls.position_mm),
        rms_after_px=view.rms_px(checked_mm),
    )


def _statistics(
    part: Part, found: Displacements, views: Sequence[View]
) -> tuple[tuple[MeasuredBall, ...], Array, tuple[float, float] | None]:
    """Each ball; the standard deviation that is left of each, shape (B,); and that of all of them together."""
    moved, axes = _in_space(found.mean_mm), found.mean_mm.shape[1]
    usual_mm = float(np.median(np.abs(found.mean_mm))) / 0.6745
    counts = np.bincount(np.concatenate([view.index for view in views]), minlength=len(moved))
    covariance, frame = found.covariance_mm2, None
    if part.kind == "guide":
        rigid = rigid_motions(part.balls.position_mm)
        covariance = without(covariance, rigid)
        together = found.spread_mm**2 * np.linalg.inv(rigid.T @ rigid)
        turn, shift = (float(np.sqrt(np.trace(together[rows, rows]) / 3.0)) for rows in (slice(3), slice(3, 6)))
        frame = (shift, float(np.degrees(turn)))
    sd_mm = np.sqrt(np.diag(covariance).reshape(len(moved), axes).mean(axis=1))
    balls = tuple(
        MeasuredBall(
            id=name,
            images=int(counts[ball]),
            displacement_mm=_row(moved[ball]),
            covariance_mm2=_matrix(found.ball_covariance_mm2(ball)),
            outlier=bool(np.abs(moved[ball]).max() > _OUTLIER_SIGMAS * usual_mm),
        )
        for ball, name in enumerate(part.balls.ids)
    )
    return balls, np.asarray(sd_mm), frame


def _row(values: Array) -> Vector3:
    return float(values[0]), float(values[1]), float(values[2])


def _matrix(covariance: Array) -> tuple[Vector3, Vector3, Vector3]:
    """In three axes; nothing is stated along one that was not estimated."""
    whole = np.zeros((3, 3))
    whole[: len(covariance), : len(covariance)] = covariance
    return _row(whole[0]), _row(whole[1]), _row(whole[2])

"""The nail's fit by itself on independent X-ray images: camera, distortion and guide from their truth.

usage: python -m benchmarks.accuracy.nail_fit [--seed 1] [--start-deg 3] [--start-mm 1] [IMAGE ...]

Looks for the images in the folder named by DISTALOCK_FLUOROSCOPY, or in ../shared/fluoroscopy. The start is the true
pose moved at random. Prints the error of every image, over its predicted standard deviation too, and the summary.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from benchmarks.data.independent_images import (
    BallTruth,
    Display,
    Entry,
    ListedImage,
    Truth,
    independent_folder,
    listed_images,
    nearest_pose,
)
from services.registration.core.nail.fit import fit_nail
from services.registration.core.nail.occluders import Occluders, PlacedGuide
from services.registration.core.nail.region import FitInput
from shared.errors import Rejected
from shared.geometry.calibration import BallCandidates, CArmCalibration
from shared.geometry.camera import DisplacementField, PinholeCamera
from shared.geometry.frames import Camera, Guide, Nail, Ring
from shared.geometry.lines import angle_between_rad
from shared.geometry.parts import NailPart, hole_surface_points
from shared.geometry.transform import Transform
from shared.parts.files import guide_from_json, nail_from_json, ring_from_json

_NODE_SPACING_PX = 32.0
_SIDE_PX = 1024


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """An image with its truth."""

    name: str
    pixels: NDArray[np.float32]
    calibration: CArmCalibration
    nail: NailPart
    occluders: Occluders
    camera_from_nail: Transform[Camera, Nail]


def load_case(image: ListedImage) -> Case:
    """Read an image as rendered (the display's rotation and mirror undone), and its truth."""
    truth = image.truth()
    assert truth.camera_from_guide is not None
    assert truth.camera_from_nail is not None
    shown = cv2.imread(str(image.path), cv2.IMREAD_UNCHANGED)
    if shown is None:
        raise FileNotFoundError(f"{image.path} is not an image that can be read")
    pixels = _as_rendered(np.asarray(shown, dtype=np.float32), image.entry.display)
    ring, guide = ring_from_json(image.ring.read_bytes()), guide_from_json(image.guide.read_bytes())
    camera_from_guide: Transform[Camera, Guide] = Transform(_pose(truth.camera_from_guide).rigid)
    return Case(
        image.name,
        pixels,
        _calibration(truth, _distortion(pixels.shape, truth, image.entry)),
        nail_from_json(image.nail.read_bytes()),
        Occluders(PlacedGuide(guide, camera_from_guide), ring),
        _pose(truth.camera_from_nail),
    )


def _as_rendered(image: NDArray[np.float32], display: Display) -> NDArray[np.float32]:
    turned = np.rot90(image, -display.rot90)
    return np.ascontiguousarray(turned[:, ::-1] if display.flip else turned, dtype=np.float32)


def _pose(matrix: list[list[float]]) -> Transform[Camera, Nail]:
    """Pose from a matrix that was rounded to six digits."""
    return Transform.from_matrix(nearest_pose(matrix))


def _calibration(truth: Truth, distortion: DisplacementField) -> CArmCalibration:
    none = np.zeros(0)
    camera_from_ring: Transform[Camera, Ring] = Transform(_pose(truth.camera_from_ring).rigid)
    return CArmCalibration(
        width_px=_SIDE_PX,
        height_px=_SIDE_PX,
        mirrored=False,
        camera=PinholeCamera(np.array(truth.intrinsic_matrix_px)),
        camera_from_ring=camera_from_ring,
        distortion=distortion,
        source_covariance_mm2=np.eye(3),
        balls=BallCandidates(np.zeros((0, 2)), none, none, none, np.zeros(0, dtype=np.int64)),
        balls_expected=0,
        distortion_residual_px=0.0,
        reprojection_rms_px=0.0,
        runner_up_margin=0.0,
        aperture=None,
    )


def _distortion(shape: tuple[int, ...], truth: Truth, entry: Entry) -> DisplacementField:
    if entry.flat_panel:
        return DisplacementField.zero(shape[1], shape[0])
    return _true_distortion(truth.balls, max(shape))


def _true_distortion(balls: Sequence[BallTruth], side: int) -> DisplacementField:
    measured = np.array([ball.image_px for ball in balls])
    ideal = np.array([ball.undistorted_px for ball in balls])
    smooth = RBFInterpolator(measured, ideal - measured, kernel="thin_plate_spline", smoothing=1e-4, degree=2)
    nodes = np.arange(-2, side / _NODE_SPACING_PX + 3) * _NODE_SPACING_PX
    x, y = np.meshgrid(nodes, nodes)
    displacement = smooth(np.column_stack([x.ravel(), y.ravel()])).reshape(len(nodes), len(nodes), 2)
    return DisplacementField(nodes[[0, 0]], _NODE_SPACING_PX, displacement, np.zeros(displacement.shape[:2]))


def errors_of(nail: NailPart, found: Transform[Camera, Nail], true: Transform[Camera, Nail]) -> tuple[float, float]:
    """Largest error over the holes: entry point across the true axis in mm, and axis in degrees."""
    offsets, angles = [], []
    for hole in nail.holes:
        entry, _ = hole_surface_points(nail, hole)
        axis, axis_found = true.directions(hole.axis.direction), found.directions(hole.axis.direction)
        apart = (found @ entry) - (true @ entry)
        offsets.append(float(np.linalg.norm(apart - axis * (apart @ axis))))
        angles.append(float(np.degrees(angle_between_rad(axis, axis_found))))
    return max(offsets), max(angles)


def run(case: Case, start: Transform[Camera, Nail]) -> NDArray[np.float64] | None:
    """Fit and print one image; entry error, axis error and the six normalised errors, or None when refused."""
    begun = time.process_time()
    result = fit_nail(FitInput(case.pixels, case.calibration, case.nail, case.occluders), start)
    seconds = time.process_time() - begun
    if isinstance(result, Rejected):
        print(f"{case.name}  refused: {'; '.join(r.message for r in result.reasons)}", flush=True)
        return None
    fit, evidence = result.value, result.value.evidence
    motion = fit.camera_from_nail.inverse() @ case.camera_from_nail
    off = np.concatenate([motion.rotation_vector_rad, motion.translation_mm])
    entry_mm, axis_deg = errors_of(case.nail, fit.camera_from_nail, case.camera_from_nail)
    normalised = off / np.sqrt(np.diag(fit.errors.covariance))
    radii = f"{evidence.hole_radius_excess_mm:+.3f} {evidence.nail_radius_excess_mm:+.3f} mm"
    print(
        f"{case.name}  {entry_mm:.3f} mm  {axis_deg:.3f} deg  margin {evidence.mirror_margin:5.0f}  radii {radii}  "
        f"structure {evidence.residual.structure:.2f}  normalised {np.round(normalised, 1)}  {seconds:.1f} s",
        flush=True,
    )
    return np.concatenate([[entry_mm, axis_deg], normalised])


def main() -> int:
    """Run the images asked for, or all that must be accepted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("images", nargs="*")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start-deg", type=float, default=3.0)
    parser.add_argument("--start-mm", type=float, default=1.0)
    options = parser.parse_args()
    folder = independent_folder()
    if folder is None:
        print("the independent images are not here; name their folder in DISTALOCK_FLUOROSCOPY")
        return 0
    rng = np.random.default_rng(options.seed)
    rows = []
    for image in (i for i in listed_images(folder, options.images) if i.entry.expect == "accept"):
        case = load_case(image)
        turn, shift = rng.normal(size=3) * options.start_deg, rng.normal(size=3) * [1.0, 1.0, 3.0] * options.start_mm
        rows.append(run(case, case.camera_from_nail @ Transform[Nail, Nail].from_rotvec(np.radians(turn), shift)))
    table = np.array([row for row in rows if row is not None])
    print(
        f"{len(table)} of {len(rows)} accepted (seed {options.seed}, start off by {options.start_deg} deg and "
        f"{options.start_mm} mm per axis)"
    )
    for name, values, unit in (("entry", table[:, 0], "mm"), ("axis", table[:, 1], "deg")):
        middle, high = np.percentile(values, [50.0, 95.0])
        print(f"{name:5} median {middle:.3f}  95 % {high:.3f}  worst {values.max():.3f} {unit}")
    print(f"normalised errors, rms: {np.round(np.sqrt(np.mean(table[:, 2:] ** 2, axis=0)), 2)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""`distalock robot calibrate-guide`: how the head holds the guide, from X-ray images in several of its poses."""

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from distalock.arguments import EXIT_BAD_INPUT
from distalock.locate import EXIT_ACCEPTED, EXIT_REJECTED, NominalOptions
from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.imaging.devices.image_file import read_image
from services.registration.core.guide import GuideFit, locate_guide
from services.registration.core.localise import unmirrored
from services.robot.core.guide_calibration import GuideCalibration, GuideView, calibrate_guide, view_residual
from services.robot.core.guide_judgement import GuideRefusal, head_finding, judge_calibration
from services.robot.core.guide_poses import suggested_poses
from shared.errors import ImageUnreadable, InputError, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Guide, RobotTop
from shared.geometry.hexapod import HexapodPart, PlatformPose
from shared.geometry.parts import GuidePart, RingPart
from shared.geometry.transform import Transform
from shared.parts.files import PartModel, guide_from_json, parse_part, read_part_file, ring_from_json
from shared.parts.hexapod_file import PoseFile, hexapod_from_json

LEAST_IMAGES = 5
LARGEST_GUIDE_RESIDUAL_PX = 0.3


class SeenPose(PartModel):
    """One image, and where the controller said that the platform stood."""

    image: Annotated[str, Field(min_length=1)]
    pose: PoseFile


class GuidePosesFile(PartModel):
    """Images for a calibration with their poses; the last one is the check."""

    schema_name: Literal["distalock/guide-poses/1"] = Field(alias="schema")
    units: Literal["mm"]
    images: tuple[SeenPose, ...] = Field(min_length=LEAST_IMAGES)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """An image that can be used, or a sentence that says why not."""

    view: GuideView | None
    why_not: str = ""


def guide_view(
    pixels: NDArray[np.float32], ring: RingPart, guide: GuidePart, nominal: NominalGeometry, pose: PlatformPose
) -> Seen:
    """The guide in the ring's frame, from one image.

    Parameters
    ----------
    pixels
        The image as received, darker is denser, shape (rows, columns).
    pose
        Where the controller said that the platform stood.
    """
    calibrated = calibrate_image(pixels, ring, nominal)
    if isinstance(calibrated, Rejected):
        return Seen(None, calibrated.reasons[0].message)
    calibration = calibrated.value
    found = locate_guide(unmirrored(pixels, calibration), calibration, ring, guide)
    if isinstance(found, Rejected):
        return Seen(None, found.reasons[0].message)
    fit = found.value
    if fit.reprojection_rms_px > LARGEST_GUIDE_RESIDUAL_PX:
        return Seen(
            None,
            f"the guide's balls are {fit.reprojection_rms_px:.2f} px from where its file puts them (limit "
            f"{LARGEST_GUIDE_RESIDUAL_PX:g}); the block is bent or is another guide: replace it or measure it anew",
        )
    ring_from_guide = calibration.camera_from_ring.inverse() @ fit.camera_from_guide
    return Seen(GuideView(pose, ring_from_guide.matrix, _covariance(calibration, fit)))


def _covariance(calibration: CArmCalibration, fit: GuideFit) -> NDArray[np.float64]:
    """The fit's own, and that of the focal spot: an object on the way to the ring follows it by the rest of the way."""
    source_ring_mm = calibration.camera_from_ring.inverse().translation_mm
    ring_from_guide = calibration.camera_from_ring.inverse() @ fit.camera_from_guide
    rest = abs(float(ring_from_guide.translation_mm[2] / source_ring_mm[2]))
    covariance = np.array(fit.covariance)
    turned = ring_from_guide.rotation.T @ calibration.source_covariance_mm2 @ ring_from_guide.rotation
    covariance[3:, 3:] += rest**2 * turned
    return covariance


def run(given: argparse.Namespace) -> int:
    """Calibrate; 0 accepted, 3 rejected, 2 bad input."""
    try:
        hexapod_json = read_part_file(given.hexapod)
        hexapod = hexapod_from_json(hexapod_json, str(given.hexapod))
        nominal_head = _nominal_head(hexapod, given.head_extension_mm)
        views = _views(given)
        calibration = calibrate_guide(hexapod, views[:-1], nominal_head)
        reasons = judge_calibration(hexapod, given.head_extension_mm, calibration, views[:-1], views[-1])
        if given.out is not None and not reasons:
            write_hexapod(given.out, hexapod_json, calibration, given.head_extension_mm)
    except InputError as error:
        print(f"distalock robot calibrate-guide: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    print(json.dumps(_printed(hexapod, calibration, reasons, views[-1])))
    return EXIT_REJECTED if reasons else EXIT_ACCEPTED


def _nominal_head(hexapod: HexapodPart, head_extension_mm: float) -> Transform[RobotTop, Guide]:
    try:
        return hexapod.top_from_guide(head_extension_mm)
    except ValueError as error:
        raise InputError(str(error)) from None


def _views(given: argparse.Namespace) -> list[GuideView]:
    file = parse_part(GuidePosesFile, read_part_file(given.poses), str(given.poses))
    ring = ring_from_json(read_part_file(given.ring), str(given.ring))
    guide = guide_from_json(read_part_file(given.guide), str(given.guide))
    options = NominalOptions(given.source_to_detector_mm, given.pixel_mm)
    return [_view(given.poses.parent / seen.image, seen.pose.pose(), ring, guide, options) for seen in file.images]


def _view(image: Path, pose: PlatformPose, ring: RingPart, guide: GuidePart, options: NominalOptions) -> GuideView:
    try:
        content = image.read_bytes()
    except OSError as error:
        raise ImageUnreadable(f"{image}: cannot be read: {error.strerror or error}") from None
    received = read_image(content, str(image))
    seen = guide_view(received.pixels, ring, guide, options.geometry(received.acquisition), pose)
    if seen.view is None:
        raise ImageUnreadable(f"{image}: {seen.why_not}")
    return seen.view


def _printed(
    hexapod: HexapodPart, calibration: GuideCalibration, reasons: tuple[GuideRefusal, ...], check: GuideView
) -> dict[str, object]:
    head = head_finding(hexapod, calibration.top_from_guide)
    check_mm, check_deg = view_residual(hexapod, calibration, check)
    return {
        "schema": "distalock/guide-calibration/1",
        "verdict": "rejected" if reasons else "accepted",
        "reasons": [{"code": r.code.value, "message": r.message} for r in reasons],
        "top_from_guide": calibration.top_from_guide.matrix.tolist(),
        "standard_uncertainty": {
            "translation_mm": calibration.translation_sd_mm,
            "rotation_deg": calibration.rotation_sd_deg,
        },
        "covariance": calibration.covariance.tolist(),
        "normalised_rms": calibration.normalised_rms,
        "check": {"distance_mm": check_mm, "angle_deg": check_deg},
        "head": {"extension_mm": head.extension_mm, "turned_deg": head.turned_deg, "beside_mm": head.beside_mm},
    }


def write_hexapod(file: Path, hexapod_json: bytes, calibration: GuideCalibration, head_extension_mm: float) -> None:
    """Write the hexapod file again, with its head as found at an extension; raises `InputError` when it cannot be."""
    content = json.loads(hexapod_json)
    found = calibration.top_from_guide
    retracted_mm = found.translation_mm - np.array([head_extension_mm, 0.0, 0.0])
    content["head"]["top_from_guide_rotation"] = found.rotation.tolist()
    content["head"]["top_from_guide_translation_at_zero_mm"] = retracted_mm.tolist()
    try:
        file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{file}: the hexapod file cannot be written: {error.strerror or error}") from None


def print_poses(given: argparse.Namespace) -> int:
    """Print poses to take images in, as a file for `calibrate-guide`; 0, or 2 with one line on stderr."""
    try:
        hexapod = hexapod_from_json(read_part_file(given.hexapod), str(given.hexapod))
        _nominal_head(hexapod, given.head_extension_mm)
    except InputError as error:
        print(f"distalock robot calibration-poses: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    poses = suggested_poses(hexapod, given.head_extension_mm, given.count)
    names = ("x_mm", "y_mm", "z_mm", "u_deg", "v_deg", "w_deg")
    images = [
        {"image": f"{number}.png", "pose": dict(zip(names, pose.as_array().tolist(), strict=True))}
        for number, pose in enumerate(poses, 1)
    ]
    print(json.dumps({"schema": "distalock/guide-poses/1", "units": "mm", "images": images}, indent=1))
    return 0

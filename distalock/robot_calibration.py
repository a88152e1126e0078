"""`distalock robot calibrate-guide`: how the head holds the guide, from X-ray images in several of its poses."""

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from distalock.arguments import EXIT_BAD_INPUT
from distalock.guide_calibration.acceptance import GuideRefusal, check_calibration, head_setting
from distalock.guide_calibration.hand_eye import GuideCalibration, GuideView, calibrate_guide, view_residual
from distalock.guide_calibration.observations import GuideObservation, views_of_one_c_arm
from distalock.guide_calibration.poses import suggested_poses
from distalock.image_files import ImageFile, read_image_file, require_different
from distalock.locate import EXIT_ACCEPTED, EXIT_REJECTED, NominalOptions
from distalock.outputs import require_apart, write_whole
from distalock.robot_guide_images import observe_guide
from shared.errors import ImageUnreadable, InputError
from shared.geometry.frames import Guide, RobotTop
from shared.geometry.hexapod import HexapodPart, PlatformPose
from shared.geometry.hexapod_limits import limit_violations
from shared.geometry.parts import GuidePart, RingPart
from shared.geometry.transform import Transform
from shared.parts.files import PartModel, guide_from_json, parse_part, read_part_file, ring_from_json
from shared.parts.guide_calibration_file import GuideCalibrationFile
from shared.parts.hexapod_file import PoseFile, hexapod_from_json, hexapod_json_with_head

LEAST_IMAGES = 5


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
class _Set:
    """What a calibration is made from."""

    hexapod_json: bytes
    hexapod: HexapodPart
    guide: GuidePart
    head_extension_mm: float
    views: tuple[GuideView, ...]


def run(given: argparse.Namespace) -> int:
    """Calibrate; 0 accepted, 3 rejected, 2 bad input."""
    try:
        taken = _read(given)
        views, check = taken.views[:-1], taken.views[-1]
        calibration = calibrate_guide(taken.hexapod, views, _nominal_head(taken.hexapod, taken.head_extension_mm))
        reasons = check_calibration(taken.hexapod, taken.head_extension_mm, calibration, views, check)
        if given.out is not None and not reasons:
            write_hexapod(given.out, taken.hexapod_json, calibration, taken.head_extension_mm)
    except InputError as error:
        print(f"distalock robot calibrate-guide: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    print(json.dumps(_printed(taken, calibration, reasons).model_dump(mode="json", by_alias=True)))
    return EXIT_REJECTED if reasons else EXIT_ACCEPTED


def _nominal_head(hexapod: HexapodPart, head_extension_mm: float) -> Transform[RobotTop, Guide]:
    try:
        return hexapod.top_from_guide(head_extension_mm)
    except ValueError as error:
        raise InputError(str(error)) from None


def _read(given: argparse.Namespace) -> _Set:
    """Read and understand all files; raises `InputError`. What is cheap to refuse comes before the images."""
    hexapod_json = read_part_file(given.hexapod)
    hexapod = hexapod_from_json(hexapod_json, str(given.hexapod))
    _nominal_head(hexapod, given.head_extension_mm)
    if given.out is not None:
        require_apart(given.out, (given.poses, given.ring, given.guide))
    file = parse_part(GuidePosesFile, read_part_file(given.poses), str(given.poses))
    _require_within_reach(hexapod, file, str(given.poses))
    ring = ring_from_json(read_part_file(given.ring), str(given.ring))
    guide = guide_from_json(read_part_file(given.guide), str(given.guide))
    options = NominalOptions.of(given)
    images = tuple(read_image_file(given.poses.parent / seen.image) for seen in file.images)
    require_different(images)
    observations = [
        _sighting(image, seen.pose.pose(), ring, guide, options)
        for image, seen in zip(images, file.images, strict=True)
    ]
    return _Set(hexapod_json, hexapod, guide, given.head_extension_mm, views_of_one_c_arm(observations))


def _require_within_reach(hexapod: HexapodPart, file: GuidePosesFile, source: str) -> None:
    """Refuse poses in which the robot cannot have stood: mixed-up units, or another robot's."""
    for number, seen in enumerate(file.images, 1):
        violations = limit_violations(hexapod, seen.pose.pose(), hexapod.pivot_mm)
        if violations:
            raise InputError(
                f"{source}: the robot cannot have stood in the pose of image {number} ('{seen.image}'): "
                f"{violations[0].message}; give X Y Z in mm and U V W in degrees, as the controller says them"
            )


def _sighting(
    image: ImageFile, pose: PlatformPose, ring: RingPart, guide: GuidePart, options: NominalOptions
) -> GuideObservation:
    geometry = options.geometry(image.content.acquisition)
    seen = observe_guide(options.pixels(image.content.pixels), ring, guide, geometry, pose)
    if seen.observation is None:
        raise ImageUnreadable(f"{image.path}: {seen.why_not}")
    return seen.observation


def _printed(taken: _Set, calibration: GuideCalibration, reasons: tuple[GuideRefusal, ...]) -> GuideCalibrationFile:
    head = head_setting(taken.hexapod, calibration.top_from_guide)
    check_mm, check_deg = view_residual(taken.hexapod, calibration, taken.views[-1])
    return GuideCalibrationFile.model_validate(
        {
            "schema": "distalock/guide-calibration/1",
            "verdict": "rejected" if reasons else "accepted",
            "reasons": [{"code": r.code.value, "message": r.message} for r in reasons],
            "hexapod_sha256": taken.hexapod.sha256,
            "guide_sha256": taken.guide.sha256,
            "head_extension_mm": taken.head_extension_mm,
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
    )


def write_hexapod(file: Path, hexapod_json: bytes, calibration: GuideCalibration, head_extension_mm: float) -> None:
    """Write the hexapod file again, with its head as found at an extension; raises `InputError` when it cannot be."""
    content = hexapod_json_with_head(hexapod_json, calibration.top_from_guide.matrix, head_extension_mm)
    write_whole(file, content)


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

"""One rendered image with the shipped guide over a nail, its calibration, and the part files as JSON."""

import json
from dataclasses import dataclass, replace
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.localise import Parts
from services.registration.core.nail.forward_model import StageSettings, model_at
from services.registration.core.nail.least_squares import Problem, problem_for
from services.registration.core.nail.occluders import Occluders, PlacedGuide
from services.registration.core.nail.parameters import POSE_ONLY, prior_mean
from services.registration.core.nail.region import FitInput
from services.registration.frames import parts_from_json
from shared.equipment import USUAL_DRILL_DIAMETER_MM
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform
from shared.xray.detection import detect_balls
from tests.kept import kept
from tests.unit.services.registration.xray_scene import Scene, calibration, posed_guide, posed_nail, render

SIZE_PX = 640
CAMERA_FROM_GUIDE = posed_guide(31.0, (2.0, -3.0, 632.0))
CAMERA_FROM_NAIL = posed_nail(34.0, (2.0, -2.5), (0.5, 1.0, 740.0))

RING_JSON = json.dumps(
    {
        "schema": "distalock/ring/1",
        "units": "mm",
        "balls": [
            {"id": f"R{k}", "position_mm": [400.0 + 10.0 * k, 400.0, 0.0], "diameter_mm": 2.0} for k in range(16)
        ],
        "plates": [{"z_mm": 0.0, "radius_mm": 100.0, "thickness_mm": 3.0}],
    }
)
GUIDE_JSON = files("shared.parts").joinpath("catalogue/guide-28.json").read_text()
NAIL_JSON = json.dumps(
    {
        "schema": "distalock/nail/1",
        "units": "mm",
        "material": "steel",
        "diameter_mm": 12.0,
        "cannulation_diameter_mm": 0,
        "tip_x_mm": 38.0,
        "holes": [
            {"id": name, "position_mm": [x, 0, 0], "direction": [0, 0, 1], "diameter_mm": 6.0}
            for name, x in (("distal", 15.0), ("proximal", -15.0))
        ],
    }
)
HEXAPOD_JSON = files("shared.parts").joinpath("catalogue/hexapod-h70.json").read_text()


def rendered_parts() -> Parts:
    """Ring (its balls outside the image), the shipped guide, a steel nail."""
    return parts_from_json(RING_JSON.encode(), GUIDE_JSON.encode(), NAIL_JSON.encode(), USUAL_DRILL_DIAMETER_MM)


@dataclass(frozen=True, eq=False)
class Shown:
    """Which things are in the image, and how the display shows it."""

    guide: Transform[Camera, Guide] | None = CAMERA_FROM_GUIDE
    nail: Transform[Camera, Nail] | None = CAMERA_FROM_NAIL
    mirrored: bool = False


@kept
def rendered(shown: Shown, seed: int) -> tuple[NDArray[np.float32], CArmCalibration]:
    """The image as received, and its calibration."""
    parts, view = rendered_parts(), calibration(SIZE_PX)
    balls = np.zeros((0, 4))
    if shown.guide is not None:
        pattern = parts.guide.balls
        balls = np.column_stack([shown.guide.points(pattern.position_mm), pattern.diameter_mm])
    scene = Scene(SIZE_PX, None if shown.nail is None else parts.nail, shown.nail, balls=balls)
    pixels = render(scene, view, seed)
    found = detect_balls(pixels, np.ones(pixels.shape, dtype=bool), (3.5, 9.0))
    received = np.ascontiguousarray(pixels[:, ::-1]) if shown.mirrored else pixels
    return received, replace(view, balls=found, mirrored=shown.mirrored)


def pose_problem(stage: StageSettings, reduction: int) -> tuple[Problem, NDArray[np.float64]]:
    """The nail's fit at the true pose with the pose alone free, and all its unknowns there."""
    parts, (pixels, view) = rendered_parts(), rendered(Shown(), seed=3)
    given = FitInput(pixels, view, parts.nail, Occluders(PlacedGuide(parts.guide, CAMERA_FROM_GUIDE), parts.ring))
    model = model_at(given, CAMERA_FROM_NAIL, stage, reduction)
    assert model is not None
    return problem_for(model, stage, POSE_ONLY), model.with_pose(prior_mean(), CAMERA_FROM_NAIL)


def true_guide_from_nail(shown: Shown) -> Transform[Guide, Nail]:
    """What a localisation should find."""
    assert shown.guide is not None
    assert shown.nail is not None
    return shown.guide.inverse() @ shown.nail


def turned_nail(tilt_xy_deg: tuple[float, float]) -> Transform[Camera, Nail]:
    """The nail where it is, tilted otherwise."""
    spin = Rotation.from_euler("z", 34.0, degrees=True)
    tilt = Rotation.from_euler("xy", tilt_xy_deg, degrees=True)
    return Transform.from_rotation_translation((tilt * spin).as_matrix(), CAMERA_FROM_NAIL.translation_mm)

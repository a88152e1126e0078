"""K-wires on rendered images: scenes, and what is true in them."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from services.registration.core.drill_clearance import AxisOffset
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.wires.image import RegisteredImage
from services.registration.core.wires.joint_estimate import JointRegistration
from services.registration.core.wires.verify import AxisComparison, WireVerification, verify_wires
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import Line, across_axis_offset_mm
from shared.geometry.parts import NailPart, hole_surface_points
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import rendered_parts
from tests.unit.services.registration.xray_scene import (
    Rod,
    Scene,
    calibration,
    guide_part,
    nail_part,
    posed_guide,
    render,
)

SIZE_PX = 640
WIRE_DIAMETER_MM = 2.0
GUIDE_COVARIANCE = np.diag([np.radians(0.03) ** 2] * 3 + [0.03**2, 0.03**2, 0.15**2])
GUIDE_FROM_NAIL: Transform[Guide, Nail] = Transform.from_rotation_translation(
    Rotation.from_euler("xyz", [0.4, -0.3, 0.5], degrees=True).as_matrix(), np.array([0.2, -0.1, 115.0])
)
LATERAL = posed_guide(25.0, (1.0, -2.0, 625.0))
NO_OFFSETS = {"distal": np.zeros(4), "proximal": np.zeros(4)}


def oblique(angle_deg: float) -> Transform[Camera, Guide]:
    """The guide as a C-arm sees it that was turned about the nail's axis, through the nail."""
    turn = Rotation.from_euler("x", angle_deg, degrees=True)
    spin = Rotation.from_euler("z", 25.0, degrees=True)
    pivot_guide = np.array([0.0, 0.0, 100.0])
    rotation = (spin * turn).as_matrix()
    return Transform.from_rotation_translation(rotation, np.array([0.0, 0.0, 735.0]) - rotation @ pivot_guide)


@dataclass(frozen=True)
class Wired:
    """True wires, in the guide's frame: offsets across the guide holes at the guide and 110 mm on, in mm."""

    offsets_mm: dict[str, NDArray[np.float64]]

    def line(self, hole_id: str) -> Line:
        hole = next(h for h in guide_part().holes if h.id == hole_id)
        start, far = self.offsets_mm[hole_id].reshape(2, 2)
        slope = (far - start) / 110.0
        return Line(hole.axis.point_mm + np.array([*start, 0.0]), np.array([*slope, 1.0]))

    def rods(self, camera_from_guide: Transform[Camera, Guide], tip_mm: float) -> tuple[Rod, ...]:
        lines = [self.line(hole_id) for hole_id in self.offsets_mm]
        along = [(line, -55.0 / line.direction[2], tip_mm / line.direction[2]) for line in lines]
        return tuple(
            Rod(
                camera_from_guide @ (line.point_mm + low * line.direction),
                camera_from_guide @ (line.point_mm + high * line.direction),
                WIRE_DIAMETER_MM,
            )
            for line, low, high in along
        )


def view_of(
    camera_from_guide: Transform[Camera, Guide], wires: Wired, seed: int, tip_mm: float = 112.0
) -> RegisteredImage:
    camera, nail = calibration(SIZE_PX), nail_part()
    rods = wires.rods(camera_from_guide, tip_mm)
    scene = Scene(SIZE_PX, nail, camera_from_guide @ GUIDE_FROM_NAIL, rods)
    return RegisteredImage(render(scene, camera, seed), camera, camera_from_guide, GUIDE_COVARIANCE)


def estimates(nail: NailPart) -> tuple[HoleEstimate, ...]:
    found = []
    for hole in nail.holes:
        entry, leaving = (GUIDE_FROM_NAIL @ point for point in hole_surface_points(nail, hole))
        axis = Line(entry, GUIDE_FROM_NAIL.directions(hole.axis.direction))
        offset = AxisOffset(np.zeros(4), np.eye(4) * 0.02**2, float(np.linalg.norm(leaving - entry)))
        found.append(HoleEstimate(hole.id, axis, entry, leaving, hole.diameter_mm, 4.0, 0.0, offset))
    return tuple(found)


def joint(*views: RegisteredImage) -> JointRegistration:
    """Guide poses as wrong as their covariances say, and a nail in its place, independent of them."""
    covariance = np.diag([1e-12] * 3 + [0.02**2] * 3)
    return JointRegistration(views, GUIDE_FROM_NAIL, block_diag(*(view.guide_covariance for view in views), covariance))


def verified(*views: RegisteredImage) -> WireVerification:
    return verify_wires(
        joint(*views), replace(rendered_parts(), guide=guide_part(), nail=nail_part()), WIRE_DIAMETER_MM
    )


def true_offsets_mm(wires: Wired, hole_id: str) -> tuple[float, float]:
    hole = next(h for h in estimates(nail_part()) if h.id == hole_id)
    entry, leaving = hole.entry_guide_mm, hole.exit_guide_mm
    line = wires.line(hole_id)
    return across_axis_offset_mm(hole.axis_guide, line, entry), across_axis_offset_mm(hole.axis_guide, line, leaving)


def assert_explains(comparison: AxisComparison, wires: Wired, sigmas: float = 3.0) -> None:
    entry_mm, exit_mm = true_offsets_mm(wires, comparison.hole.id)
    assert abs(comparison.offset.entry_mm - entry_mm) < sigmas * comparison.offset.entry_sd_mm
    assert abs(comparison.offset.exit_mm - exit_mm) < sigmas * comparison.offset.entry_sd_mm + 0.2


ALONG_THE_GUIDE = Wired(NO_OFFSETS)
ASKEW = Wired({"distal": np.array([0.6, -0.4, 1.6, -0.9]), "proximal": np.array([-0.5, 0.3, -1.2, 1.3])})

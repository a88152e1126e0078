"""Where the two screws of the mount go: advised from an image of the nail before the robot is mounted. Pure.

The base stands over the nail with its middle as far proximal of the holes as the head reaches distally, so the range of
the head's extension is where its screws go. In the middle of it the head can still give way to both sides; where the
image does not show that place, the nearest one that it shows is advised. The screws lie side by side along
the nail, their axes parallel to those of the holes, so that the robot starts near the pose it has to reach.

In a lateral image the screws' axes run towards the nail: a screw ends in the near cortex, and the depth is not in the
image.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from services.registration.core.localise import LocalisationResult, Parts
from services.registration.core.tuning import MOUNTING_SITE
from shared.geometry.bend import section_frame
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.hexapod import HexapodPart
from shared.geometry.lines import angle_between_rad
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class MountingScrew:
    """The axis of one screw, for the jig."""

    id: Literal["distal", "proximal"]
    proximal_mm: float  # from the middle between the nail's holes, along the nail
    # Towards the surgeon, and where the axis meets the nail, in the image's measured pixels, shape (2, 2)
    axis_px: NDArray[np.float64]
    tilt_to_ray_deg: float
    shown: bool  # whether the image shows both


@dataclass(frozen=True, slots=True, eq=False)
class MountingSite:
    """Where to mount the base, and the extension of the head that then brings the guide over the holes."""

    head_extension_mm: float
    screws: tuple[MountingScrew, ...]  # the distal one first
    screw_diameter_mm: float
    screw_diameter_px: float  # at the nail, midway between both
    range_px: NDArray[np.float64]  # both ends on the nail's axis of where screws may be, shape (2, 2)

    @property
    def shown(self) -> bool:
        """Whether the image shows the place of both screws."""
        return all(screw.shown for screw in self.screws)


def site_of_nail(
    result: LocalisationResult, calibration: CArmCalibration | None, parts: Parts, hexapod: HexapodPart
) -> MountingSite | None:
    """Advise where the screws go when the image shows the nail."""
    if calibration is None or result.nail is None:
        return None
    nail = parts.with_nail_as_found(result.nail).nail
    return mounting_site(calibration, result.nail.camera_from_nail, nail, hexapod)


def mounting_site(
    calibration: CArmCalibration, camera_from_nail: Transform[Camera, Nail], nail: NailPart, hexapod: HexapodPart
) -> MountingSite:
    """Advise where the screws go; the place nearest to the middle of the head's range that the image shows.

    Parameters
    ----------
    nail
        As it was found, bent as it is.
    """
    reach, half_mm = hexapod.head_extension_mm, 0.5 * hexapod.bone_screws.spacing_mm
    middle_mm = 0.5 * (reach.minimum + reach.maximum)
    aside_mm = max(0.5 * (reach.maximum - reach.minimum) - half_mm, 0.0)
    steps_mm = np.append(np.arange(0.0, aside_mm, MOUNTING_SITE.step_mm), aside_mm)
    # distally first: there the image is more likely to end beyond
    places_mm = (middle_mm + steps_mm[:, None] * [-1.0, 1.0]).ravel().tolist()
    sites = (_site(calibration, camera_from_nail, nail, hexapod, place_mm) for place_mm in places_mm)
    shown = next((site for site in sites if site.shown), None)
    return shown or _site(calibration, camera_from_nail, nail, hexapod, middle_mm)


def _site(
    calibration: CArmCalibration,
    camera_from_nail: Transform[Camera, Nail],
    nail: NailPart,
    hexapod: HexapodPart,
    extension_mm: float,
) -> MountingSite:
    half_mm = 0.5 * hexapod.bone_screws.spacing_mm
    reach = hexapod.head_extension_mm
    ends_mm = np.array([_on_axis_mm(nail, -reach.minimum, 0.0), _on_axis_mm(nail, -reach.maximum, 0.0)])
    here_mm = camera_from_nail.points(_on_axis_mm(nail, -extension_mm, 0.0))
    return MountingSite(
        extension_mm,
        (
            _screw(calibration, camera_from_nail, nail, "distal", extension_mm - half_mm),
            _screw(calibration, camera_from_nail, nail, "proximal", extension_mm + half_mm),
        ),
        hexapod.bone_screws.diameter_mm,
        calibration.camera.focal_length_px * hexapod.bone_screws.diameter_mm / float(here_mm[2]),
        calibration.image_from_camera(camera_from_nail.points(ends_mm)),
    )


def _screw(
    calibration: CArmCalibration,
    camera_from_nail: Transform[Camera, Nail],
    nail: NailPart,
    name: Literal["distal", "proximal"],
    proximal_mm: float,
) -> MountingScrew:
    outside_mm = _on_axis_mm(nail, -proximal_mm, nail.radius_mm + MOUNTING_SITE.towards_surgeon_mm)
    at_nail_mm = _on_axis_mm(nail, -proximal_mm, nail.radius_mm)
    ends_camera_mm = camera_from_nail.points(np.array([outside_mm, at_nail_mm]))
    axis_px = calibration.image_from_camera(ends_camera_mm)
    tilt_rad = angle_between_rad(ends_camera_mm[1] - ends_camera_mm[0], ends_camera_mm[1])
    shown = calibration.shows(axis_px[:, 0], axis_px[:, 1], MOUNTING_SITE.border_px)
    return MountingScrew(name, proximal_mm, axis_px, float(np.degrees(tilt_rad)), bool(shown.all()))


def _on_axis_mm(nail: NailPart, x_mm: float, towards_surgeon_mm: float) -> NDArray[np.float64]:
    """A point of the nail's frame beside its centre line, against the direction of drilling, shape (3,)."""
    point: NDArray[np.float64] = section_frame(nail.curvature_per_m, x_mm) @ np.array([0.0, 0.0, -towards_surgeon_mm])
    return point

"""Turning the C-arm: about the axes of the image, as the product advises, and as far as it reaches."""

import numpy as np
from scipy.spatial.transform import Rotation

from simulation.render.display import turned_from_detector
from simulation.scenario.c_arm_angles import CArmAngles, angles_of_beam, c_arm_rotation
from simulation.scenario.values import Scenario

# A mobile C-arm: the angular and orbital ranges of the makers' data sheets, generously.
ANGULAR_LIMIT_DEG = 80.0
ORBITAL_LIMIT_DEG = 180.0


class OutOfReach(ValueError):
    """The C-arm cannot be turned that far."""


def check_reach(angles: CArmAngles) -> None:
    """Refuse angles that no C-arm has; raises `OutOfReach`."""
    if abs(angles.orbital_deg) > ORBITAL_LIMIT_DEG or abs(angles.angular_deg) > ANGULAR_LIMIT_DEG:
        raise OutOfReach(
            f"the C-arm would stand at {angles.orbital_deg:.1f}° orbital and {angles.angular_deg:.1f}° angular, "
            f"it reaches ±{ORBITAL_LIMIT_DEG:g}° and ±{ANGULAR_LIMIT_DEG:g}°; ask for smaller angles"
        )


def turned_about_image(
    scenario: Scenario, angles: CArmAngles, about_image_x_deg: float, about_image_y_deg: float
) -> CArmAngles:
    """Angles after source and detector were turned together about the axes of the camera's frame.

    The camera's frame is that of the un-mirrored, turned image, right-handed, as in the product's advice. A C-arm
    cannot be turned about its beam to order, so only the beam's direction follows the request exactly.
    """
    beam_from_camera = turned_from_detector(scenario.display).T
    turn = Rotation.from_rotvec(beam_from_camera @ np.radians([about_image_x_deg, about_image_y_deg, 0.0]))
    room_from_beam = c_arm_rotation(angles, scenario.c_arm.roll_deg)
    return angles_of_beam((room_from_beam @ turn.as_matrix())[:, 2])

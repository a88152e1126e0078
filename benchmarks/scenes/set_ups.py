"""One patient and one position of the guide, seen from several directions: for benchmarks of several images."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.scenes.random_scenes import nominal_of, parts_of, scene_of_seed
from services.imaging.core.calibration import calibrate_image
from services.registration.core.localise import LocalisationResult, Parts, localise
from shared.errors import Reason, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Room
from shared.geometry.lines import unit
from shared.geometry.transform import Transform
from simulation.render.image import Shot, render_scene
from simulation.scenario.c_arm_angles import angles_of_beam, c_arm_rotation
from simulation.scenario.values import Scenario
from simulation.world.poses import WorldState, starting_state, world_at


@dataclass(frozen=True, slots=True, eq=False)
class SeenImage:
    """One image with what was found in it; calibration and result are None when the ring was not found."""

    shot: Shot
    calibration: CArmCalibration | None
    result: LocalisationResult | None
    reasons: tuple[Reason, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SetUp:
    """A patient, a nail and a guide.

    Attributes
    ----------
    parts
        What the localisation is told of the parts.
    """

    scenario: Scenario
    state: WorldState
    parts: Parts

    @staticmethod
    def of_seed(seed: int) -> "SetUp":
        """Parts of their own for every seed, robot in its home pose, nothing inserted."""
        scenario = scene_of_seed(seed)
        return SetUp(scenario, starting_state(scenario), parts_of(scenario))

    def turned(self, about_nail_x_deg: float, about_nail_y_deg: float) -> "SetUp":
        """The C-arm turned so that its beam leans against the nail's z axis by these angles."""
        placement = self.scenario.placement
        room_from_nail = placement.room_from_bone.rotation @ placement.bone_from_nail.rotation
        lean = Rotation.from_rotvec(np.radians([about_nail_x_deg, about_nail_y_deg, 0.0])).as_matrix()
        direction = room_from_nail @ lean @ np.array([0.0, 0.0, 1.0])
        now: NDArray[np.float64] = c_arm_rotation(self.state.angles, self.scenario.c_arm.roll_deg)[:, 2]
        direction = direction * np.sign(float(direction @ now))
        return replace(self, state=replace(self.state, angles=angles_of_beam(unit(direction))))

    def centred_towards_the_guide(self, share: float) -> "SetUp":
        """The C-arm pushed along until a place between nail (0) and guide (1) lies on the axis of its beam."""
        world = world_at(self.scenario, self.state)
        place_mm = share * world.beam_from_guide.translation_mm + (1.0 - share) * world.beam_from_nail.translation_mm
        aside_mm = world.room_from_beam.rotation @ np.array([place_mm[0], place_mm[1], 0.0])
        pushed: Transform[Room, Room] = Transform.from_rotvec(np.zeros(3), -aside_mm)
        placement = replace(self.scenario.placement, room_from_bone=pushed @ self.scenario.placement.room_from_bone)
        return replace(self, scenario=replace(self.scenario, placement=placement))

    def seen(self, shot_number: int) -> SeenImage:
        """Take an image and localise in it."""
        shot = render_scene(self.scenario, self.state, shot_number)
        pixels = shot.pixels.astype(np.float32)
        calibrated = calibrate_image(pixels, self.parts.ring, nominal_of(self.scenario))
        if isinstance(calibrated, Rejected):
            return SeenImage(shot, None, None, calibrated.reasons)
        result = localise(pixels, calibrated.value, self.parts)
        return SeenImage(shot, calibrated.value, result, result.reasons)

"""The patient, the C-arm and the guide of one procedure, with what is wrong about them: images and truth."""

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.campaign.troubles import Error, Troubles
from benchmarks.robot.rig import Rig
from benchmarks.robustness.foreign_objects import DRAWS, placed
from benchmarks.robustness.processing import OPERATORS
from benchmarks.robustness.scene import generator_of, rendered
from benchmarks.scenes.random_scenes import nominal_of
from services.imaging.core.nominal import NominalGeometry
from shared.geometry.frames import Guide
from shared.geometry.transform import Transform
from simulation.render.image import ChangePacked, ImageFaults
from simulation.render.retracing import Retracing
from simulation.render.truth import AxisError, guide_axis_errors
from simulation.room.c_arm import OutOfReach
from simulation.room.drilling import Passage
from simulation.room.faults import RoomFaults
from simulation.room.operating_room import OperatingRoom
from simulation.scenario.c_arm_angles import CArmAngles
from simulation.scenario.values import Scenario

_DRAWS: Final = {one.__name__: one for one in DRAWS}


@dataclass(slots=True)
class CampaignRoom:
    """The room of one scenario, as the operating room plays it, and what is in the way of its images.

    Attributes
    ----------
    smear_px
        Length by which the next image is smeared.
    cluttered
        Whether the object lies in the beam.
    """

    scenario: Scenario
    rig: Rig
    troubles: Troubles
    smear_px: float = 0.0
    cluttered: bool = field(init=False)
    room: OperatingRoom = field(init=False)
    shots: int = 0
    _rays: Retracing = field(default_factory=Retracing)

    def __post_init__(self) -> None:
        self.cluttered = bool(self.troubles.thing)
        self.room = OperatingRoom(self.scenario, lambda: self.rig.virtual.snapshot().base_from_top)

    def shoot(self) -> tuple[NDArray[np.float32], NominalGeometry]:
        """Press the pedal: the image as it reaches imaging, and what the C-arm says of itself."""
        self.shots += 1
        faults = ImageFaults(dose_factor=self.troubles.dose, motion_blur_px=self.smear_px)
        self.smear_px = 0.0
        shot = rendered(self.scenario, self.room.state(), self._clutter(), self.shots, faults, self._rays)
        return self._displayed(shot.pixels)

    def _clutter(self) -> ChangePacked:
        """What lies in the beam."""
        if not self.cluttered:
            return lambda packed, _: packed
        objects, _ = placed(_DRAWS[self.troubles.thing], self.troubles.thing, self.scenario, self.room.world())
        return lambda packed, _: objects.added_to(packed)

    def _displayed(self, pixels: NDArray[np.integer]) -> tuple[NDArray[np.float32], NominalGeometry]:
        nominal, white = nominal_of(self.scenario), float(np.iinfo(pixels.dtype).max)
        if not self.troubles.operator:
            return pixels.astype(np.float32), nominal
        operator = OPERATORS[self.troubles.operator]
        generator = generator_of(self.troubles.operator, self.scenario.seed)
        result = operator(pixels.astype(np.float32) / np.float32(white), generator)
        top = 255.0 if result.bits == 8 else white
        factor = pixels.shape[0] / result.share.shape[0]
        shown = np.rint(result.share.astype(np.float64) * top).astype(np.float32)
        return shown, NominalGeometry(nominal.source_to_detector_mm, nominal.pixel_mm * factor)

    @property
    def angles(self) -> CArmAngles:
        """How the C-arm is turned."""
        return self.room.angles

    def turn_c_arm(self, about_x_deg: float, about_y_deg: float) -> None:
        """Turn it as advised, as far as it goes."""
        try:
            self.room.turn_c_arm_about_image(about_x_deg, about_y_deg)
        except OutOfReach:
            return

    def slip(self, shift_mm: tuple[float, float, float]) -> None:
        """The mount slips on the bone."""
        self.room.set_faults(RoomFaults(mount_shift_mm=shift_mm))

    def errors(self) -> tuple[AxisError, ...]:
        """The guide's axes against the nail's, by truth."""
        return guide_axis_errors(self.scenario, self.room.world())

    def drill(self, hole_id: str) -> Passage:
        """Drill through a hole of the guide."""
        return self.room.drill(hole_id)


def with_troubles(scenario: Scenario, troubles: Troubles) -> Scenario:
    """The scenario as it really is: a guide that is mounted the wrong way round is turned about its drilling axis."""
    if troubles.error is not Error.GUIDE_TURNED:
        return scenario
    return with_turned_guide(scenario)


def with_turned_guide(scenario: Scenario) -> Scenario:
    """The head holds the guide turned by 180° about its drilling axis."""
    turned: Transform[Guide, Guide] = Transform.from_rotvec(np.array([0.0, 0.0, np.pi]), np.zeros(3))
    hexapod = scenario.parts.hexapod
    other = replace(hexapod, top_from_guide_retracted=hexapod.top_from_guide_retracted @ turned)
    return replace(scenario, parts=replace(scenario.parts, hexapod=other))

"""Films for the guidance benchmark: a scene seen by a C-arm that turns and shifts, and an instrument in the way."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Room
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform
from simulation.render.image import NO_FAULTS, ImageFaults, Noise, View, exposed, view_of
from simulation.render.truth import ImageTruth
from simulation.scenario.c_arm_angles import CArmAngles
from simulation.scenario.values import Scenario
from simulation.world.poses import WorldState, starting_state

FloatImage = NDArray[np.float32]

_TURN_DEG, _SHIFT_MM, _INERTIA = 0.35, 0.6, 0.7
_REST_OF, _CYCLE = 3, 5


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the C-arm stands: its angles, and how far the patient lies from where he lay, in mm."""

    orbital_deg: float
    angular_deg: float
    shift_mm: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One frame with its truth."""

    pixels: FloatImage
    truth: ImageTruth


def path_of(start: WorldState, seed: int, count: int) -> Iterator[Pose]:
    """A technician's way: turning and shifting smoothly, with rests."""
    rng = np.random.default_rng([seed, *b"guidance"])
    angles = np.array([start.angles.orbital_deg, start.angles.angular_deg])
    shift, turn, drift = np.zeros(3), np.zeros(2), np.zeros(3)
    for number in range(count):
        yield Pose(float(angles[0]), float(angles[1]), (float(shift[0]), float(shift[1]), float(shift[2])))
        turn = _INERTIA * turn + rng.normal(0.0, _TURN_DEG, 2)
        drift = _INERTIA * drift + rng.normal(0.0, _SHIFT_MM, 3)
        if number % _CYCLE >= _REST_OF:
            angles, shift = angles + turn, shift + drift


class Camera:
    """Films a scene; rays are traced once for every place of the C-arm, noise is made for every frame."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._seen: tuple[Pose, bool, View] | None = None
        self._count = 0

    def frame(self, pose: Pose, *, faults: ImageFaults = NO_FAULTS, nail_present: bool = True) -> Frame:
        """One frame from a pose of the C-arm."""
        self._count += 1
        if self._seen is None or self._seen[:2] != (pose, nail_present):
            self._seen = (pose, nail_present, self._view(pose, nail_present))
        shot = exposed(self._scenario, self._seen[2], self._count, Noise.REAL, faults)
        return Frame(shot.pixels.astype(np.float32), shot.truth)

    def _view(self, pose: Pose, nail_present: bool) -> View:  # noqa: FBT001 - as `frame` has it
        placement = self._scenario.placement
        shift: Transform[Room, Room] = Transform.from_rotvec(np.zeros(3), pose.shift_mm)
        moved = replace(placement, room_from_bone=shift @ placement.room_from_bone)
        angles = CArmAngles(pose.orbital_deg, pose.angular_deg)
        state = replace(starting_state(self._scenario), angles=angles, nail_present=nail_present)
        return view_of(replace(self._scenario, placement=moved), state)


def with_instrument(frame: Frame, nail: NailPart, calibration: CArmCalibration) -> Frame:
    """The same frame with the shaft of a clamp, 9 mm wide, over the nail's first hole."""
    pixels, truth = frame.pixels.copy(), frame.truth
    assert truth.camera_from_nail is not None
    middle = truth.camera_from_nail @ nail.holes[0].axis.point_mm
    x, y = calibration.image_from_camera(middle)
    if calibration.mirrored:
        x = calibration.width_px - 1 - x
    shaft = np.zeros(pixels.shape, dtype=np.float32)
    half_px = 4.5 * calibration.camera.focal_length_px / float(middle[2])
    cv2.line(shaft, (round(x), round(y)), (round(x) + 600, round(y) + 350), 1.0, max(1, round(2.0 * half_px)))
    soft = np.asarray(cv2.GaussianBlur(shaft, (0, 0), 1.2), dtype=np.float32)
    low = float(np.percentile(pixels, 1.0))
    return Frame(np.asarray(low + (pixels - low) * (1.0 - 0.95 * soft), dtype=np.float32), truth)

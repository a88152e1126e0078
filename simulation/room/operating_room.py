"""The room while a case goes on: C-arm, inserted wires, drilled holes and faults, behind one lock."""

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from shared.geometry.frames import RobotBase, RobotTop
from shared.geometry.transform import Transform
from simulation.render.image import Noise, Shot, exposed, render_scene, view_of
from simulation.render.retracing import Retracing
from simulation.room.c_arm import check_reach, turned_about_image
from simulation.room.drilling import Passage, drill, drill_force_n, insert_wire
from simulation.room.faults import NO_ROOM_FAULTS, RoomFaults
from simulation.scenario.c_arm_angles import CArmAngles
from simulation.scenario.values import Scenario
from simulation.world.poses import World, WorldState, starting_state, world_at

PlatformReader = Callable[[], Transform[RobotBase, RobotTop]]


@dataclass(slots=True)
class _Changes:
    """What people did in the room so far."""

    angles: CArmAngles
    wires: tuple[Passage, ...] = ()
    drills: tuple[Passage, ...] = ()
    faults: RoomFaults = NO_ROOM_FAULTS
    shots: int = 0


@dataclass(slots=True)
class OperatingRoom:
    """The room of one scenario. Safe to use from several threads.

    Attributes
    ----------
    platform
        Asks the robot's controller where its platform stands now.
    """

    scenario: Scenario
    platform: PlatformReader
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _changes: _Changes = field(init=False)
    _retracing: Retracing = field(default_factory=Retracing)

    def __post_init__(self) -> None:
        self._changes = _Changes(starting_state(self.scenario).angles)

    def state(self) -> WorldState:
        """How the room stands now."""
        with self._lock:
            return self._state()

    def world(self) -> World:
        """Where everything is now."""
        return world_at(self.scenario, self.state())

    def _state(self) -> WorldState:
        changes = self._changes
        return WorldState(
            platform=self.platform(),
            angles=changes.angles,
            wires=tuple(w.rod for w in changes.wires),
            drilled=tuple(d.rod for d in changes.drills),
            nail_present=changes.faults.nail_present,
            guide_present=changes.faults.guide_present,
            ring_shift_mm=changes.faults.ring_shift_mm,
            mount_shift_mm=changes.faults.mount_shift_mm,
        )

    @property
    def angles(self) -> CArmAngles:
        """How the C-arm is turned."""
        with self._lock:
            return self._changes.angles

    def turn_c_arm(self, angles: CArmAngles) -> CArmAngles:
        """Turn the C-arm; raises `OutOfReach`."""
        check_reach(angles)
        with self._lock:
            self._changes.angles = angles
        return angles

    def turn_c_arm_about_image(self, about_image_x_deg: float, about_image_y_deg: float) -> CArmAngles:
        """Turn source and detector together about the axes of the image, as the product advises; `OutOfReach`."""
        return self.turn_c_arm(turned_about_image(self.scenario, self.angles, about_image_x_deg, about_image_y_deg))

    def shoot(self) -> tuple[int, CArmAngles, Shot]:
        """Press the foot pedal: number of the shot, the C-arm's angles, and the image."""
        with self._lock:
            self._changes.shots += 1
            number, state, faults = self._changes.shots, self._state(), self._changes.faults
        return (
            number,
            state.angles,
            render_scene(self.scenario, state, number, faults=faults.image, retracing=self._retracing),
        )

    def film(self, places: Sequence[CArmAngles], images: int) -> Iterator[tuple[int, CArmAngles, Shot]]:
        """Running fluoroscopy: so many images, while the C-arm goes through these places; it stays at the last one.

        All images show wires and faults as they were when the pedal was pressed.
        """
        with self._lock:
            first, state, faults = self._changes.shots + 1, self._state(), self._changes.faults
            self._changes.shots += images
        seen: int | None = None
        for k in range(images):
            place = k * len(places) // images
            if place != seen:
                view, seen = view_of(self.scenario, replace(state, angles=places[place])), place
            yield first + k, places[place], exposed(self.scenario, view, first + k, Noise.REAL, faults.image)
        self.turn_c_arm(places[-1])

    def insert_wires(self, hole_ids: tuple[str, ...]) -> tuple[Passage, ...]:
        """Push wires through these holes of the guide (one that is already in one is replaced); `HoleUnknown`."""
        with self._lock:
            state = self._state()
            new = tuple(insert_wire(self.scenario, state, hole_id) for hole_id in hole_ids)
            kept = tuple(w for w in self._changes.wires if w.hole_id not in hole_ids)
            self._changes.wires = kept + new
        return new

    def remove_wires(self) -> None:
        """Pull all wires out."""
        with self._lock:
            self._changes.wires = ()

    @property
    def wires(self) -> tuple[Passage, ...]:
        """The wires that are in."""
        with self._lock:
            return self._changes.wires

    def drill(self, hole_id: str) -> Passage:
        """Drill through a hole of the guide; raises `HoleUnknown`."""
        with self._lock:
            force = drill_force_n(self.scenario, len(self._changes.drills))
            passage = drill(self.scenario, self._state(), hole_id, force)
            self._changes.drills = (*self._changes.drills, passage)
        return passage

    def take_new_bone(self) -> None:
        """A bone of the same shape in which nothing was drilled: the next patient."""
        with self._lock:
            self._changes.drills = ()

    @property
    def drills(self) -> tuple[Passage, ...]:
        """What was drilled, in order."""
        with self._lock:
            return self._changes.drills

    @property
    def faults(self) -> RoomFaults:
        """The faults that are switched on."""
        with self._lock:
            return self._changes.faults

    def set_faults(self, faults: RoomFaults) -> None:
        """Replace the faults that are switched on."""
        with self._lock:
            self._changes.faults = faults

"""Imaging and scene faults that tests and demonstrations may switch on, as a value."""

from dataclasses import dataclass

from simulation.render.image import NO_FAULTS, ImageFaults


@dataclass(frozen=True, slots=True)
class RoomFaults:
    """What is wrong in the room until the faults are cleared.

    Attributes
    ----------
    image
        What is wrong with every shot.
    nail_present, guide_present
        False: somebody took it away.
    ring_shift_mm
        The ring slipped along the detector's columns.
    mount_shift_mm
        The robot's mount slipped, along the base's x, y and z.
    """

    image: ImageFaults = NO_FAULTS
    nail_present: bool = True
    guide_present: bool = True
    ring_shift_mm: float = 0.0
    mount_shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


NO_ROOM_FAULTS = RoomFaults()

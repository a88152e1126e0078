"""From the foot pedal to the delivered DICOM image."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime

from pydicom.uid import generate_uid

from simulation.c_arm import Acquisition, DicomShot, dicom_shot
from simulation.dicom_sender import DicomTarget, send
from simulation.operating_room import OperatingRoom
from simulation.truth import ImageTruth
from simulation.world import CArmAngles

Clock = Callable[[], datetime]


def now() -> datetime:
    """The time, with its zone."""
    return datetime.now(UTC)


@dataclass(frozen=True, slots=True, eq=False)
class TakenShot:
    """A shot that was taken, and sent if there is a target."""

    number: int
    taken_at: datetime
    dicom: DicomShot
    angles: CArmAngles
    truth: ImageTruth
    delivered_to: DicomTarget | None


@dataclass(slots=True)
class FootPedal:
    """Takes shots one after another and sends each.

    Attributes
    ----------
    target
        Where images go; None keeps them here.
    """

    room: OperatingRoom
    target: DicomTarget | None
    clock: Clock = now
    last: TakenShot | None = None
    _study_uid: str = field(default_factory=lambda: str(generate_uid()))
    _series_uid: str = field(default_factory=lambda: str(generate_uid()))
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    def press(self) -> TakenShot:
        """Take one shot and deliver it.

        Raises
        ------
        ImageNotDelivered
            When the target does not take it. The shot stays available as `last`.
        """
        with self._one_at_a_time:
            taken_at = self.clock()
            number, angles, shot = self.room.shoot()
            dicom = dicom_shot(
                self.room.scenario,
                angles,
                shot.pixels,
                Acquisition(taken_at, self._study_uid, self._series_uid, number),
            )
            self.last = TakenShot(number, taken_at, dicom, angles, shot.truth, None)
            if self.target is not None:
                send(dicom, self.target)
                self.last = TakenShot(number, taken_at, dicom, angles, shot.truth, self.target)
            return self.last

"""From the foot pedal to the delivered DICOM image."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from pydicom.uid import generate_uid

from simulation.dicom.image import Acquisition, DicomShot, dicom_shot
from simulation.dicom.sender import sending
from simulation.dicom.target import DicomTarget
from simulation.render.image import Shot
from simulation.render.truth import ImageTruth
from simulation.room.c_arm import check_reach, turned_about_image
from simulation.room.operating_room import OperatingRoom
from simulation.scenario.c_arm_angles import CArmAngles

Clock = Callable[[], datetime]
Send = Callable[[DicomShot], None]


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


@dataclass(frozen=True, slots=True)
class FluoroscopyRun:
    """The pedal held down.

    Attributes
    ----------
    images, images_per_s
        How many images, and how fast they are sent.
    places
        So many places the C-arm goes through, evenly on its way.
    about_image_x_deg, about_image_y_deg
        The whole way, as the product's advice puts it.
    """

    images: int
    images_per_s: float
    places: int
    about_image_x_deg: float
    about_image_y_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class RunReport:
    """How a run went.

    Attributes
    ----------
    seconds
        From the first image's sending to the last one's end.
    late
        Images that were sent later than a whole interval after their time, because the target was slow.
    """

    last: TakenShot
    seconds: float
    late: int


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
            shot = self._taken(*self.room.shoot())
            self.last = shot
            with self._sender() as deliver:
                return self._delivered(shot, deliver)

    def hold(self, run: FluoroscopyRun) -> RunReport:
        """Take a run of images, and send them at their rate; all are made before the first is sent.

        Raises
        ------
        ImageNotDelivered
            When the target does not take one.
        OutOfReach
            When the C-arm does not reach the end of its way.
        """
        with self._one_at_a_time:
            scenario, start = self.room.scenario, self.room.angles
            shares = [(k + 1) / run.places for k in range(run.places)]
            places = [
                turned_about_image(scenario, start, s * run.about_image_x_deg, s * run.about_image_y_deg)
                for s in shares
            ]
            check_reach(places[-1])
            taken = [self._taken(*image) for image in self.room.film(places, run.images)]
            interval_s, began_s, late = 1.0 / run.images_per_s, time.monotonic(), 0
            with self._sender() as deliver:
                for k, shot in enumerate(taken):
                    ahead_s = began_s + k * interval_s - time.monotonic()
                    late += ahead_s < -interval_s
                    time.sleep(max(ahead_s, 0.0))
                    last = self._delivered(shot, deliver)
            return RunReport(last, time.monotonic() - began_s, late)

    def _taken(self, number: int, angles: CArmAngles, shot: Shot) -> TakenShot:
        taken_at = self.clock()
        acquisition = Acquisition(taken_at, self._study_uid, self._series_uid, number)
        dicom = dicom_shot(self.room.scenario, angles, shot.pixels, acquisition)
        return TakenShot(number, taken_at, dicom, angles, shot.truth, None)

    @contextmanager
    def _sender(self) -> Iterator[Send | None]:
        """How to send; None when there is no target."""
        if self.target is None:
            yield None
            return
        with sending(self.target) as send_one:
            yield send_one

    def _delivered(self, shot: TakenShot, deliver: Send | None) -> TakenShot:
        self.last = shot
        if deliver is not None:
            deliver(shot.dicom)
            self.last = replace(shot, delivered_to=self.target)
        return self.last

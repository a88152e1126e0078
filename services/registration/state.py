"""State of registration: the open case, the robot, the newest images and their localisations. Thread-safe."""

import threading
from collections import OrderedDict
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from services.registration.core.wires.verify import WireVerification
from services.registration.frames import (
    AT_REST,
    LocalisedFrames,
    OpenCase,
    ReceivedFrame,
    is_unanswered,
    pose_at_rest,
    same_place,
    set_up_of,
)
from shared.messages.imaging import FrameHeader, ImageReference
from shared.messages.robot import PlatformPoseMessage, RobotState

# Chosen: a bound on memory, above the images of the longest procedure.
_MOST_ANNOUNCED = 256
# Longer than the robot service asks a slow controller again at rest: after that it is in fault.
SLOW_ANSWER_S = 1.2


class RegistrationState:
    """The newest of everything that was received or localised; `kept` images of each.

    Parameters
    ----------
    boot_epoch
        Of this run of registration: the first half of every registration epoch.
    image_delay_s
        How long an image may take from its exposure until imaging has received it, and from imaging to here: it is
        bound to the robot's pose only when the robot had stood there for so long by then.
    """

    def __init__(self, boot_epoch: str, kept: int, image_delay_s: float, clock_s: Callable[[], float]) -> None:
        self.boot_epoch = boot_epoch
        self._kept = kept
        self._image_delay_s = image_delay_s
        self.now_s = clock_s
        self._rests_at: PlatformPoseMessage | None = None
        self._resting_since_s = float("inf")
        self._changed = threading.Condition()
        self._case: OpenCase | None = None
        self._robot: RobotState | None = None
        self._counter = 0
        self._newest: ImageReference | None = None
        self._frames: OrderedDict[str, ReceivedFrame] = OrderedDict()
        # images whose pixels have not come yet, with the epochs that began with them
        self._announced: OrderedDict[str, str] = OrderedDict()
        self.images = LocalisedFrames(kept)
        self._verified: tuple[frozenset[str], WireVerification] | None = None

    def open_case(self, case: OpenCase | None) -> None:
        """Note the open case, or that none is open; another case or revision begins a new registration epoch."""
        with self._changed:
            if set_up_of(self._case) != set_up_of(case):
                self._counter += 1
            self._case = case
            self._changed.notify_all()

    def note_robot(self, state: RobotState) -> None:
        """Note the newest state of the robot; since when it rests, a new run of its service does not know.

        A controller that does not answer in one round leaves a robot at rest without a pose. It has rested if it stands
        where it stood when the controller answers again.
        """
        with self._changed:
            is_same_run = self._robot is not None and self._robot.boot_epoch == state.boot_epoch
            before = self._rests_at if is_same_run and state.state in AT_REST else None
            pose = pose_at_rest(state)
            if before is None or not (pose is None or same_place(before, pose)):
                self._resting_since_s = float("inf") if pose is None else self.now_s()
            self._rests_at = pose or before
            self._robot = state
            self._changed.notify_all()

    def note_announced(self, image: ImageReference) -> None:
        """Note that imaging has an image. If its pixels have not come, it begins a new epoch all the same."""
        with self._changed:
            if image.sha256 not in self._frames and image.sha256 not in self._announced:
                self._announced[image.sha256] = self._begin_epoch(image)
                while len(self._announced) > _MOST_ANNOUNCED:
                    self._announced.popitem(last=False)

    def note_newest(self, image: ImageReference) -> None:
        """Note an image that somebody else knows: when it is newer than all that are known here, an epoch begins."""
        with self._changed:
            if self._newest is None or self._newest.precedes(image):
                self._begin_epoch(image)

    def note_frame(self, header: FrameHeader, pixels: NDArray[np.float32]) -> ReceivedFrame:
        """Note an image that arrives now: a new epoch begins. The robot stood where it stands, if for long enough.

        While the controller does not answer, its next answer is waited for: it says whether the robot still stands
        there, and the image need not be taken again. No frame of a run waits: the next one comes soon.
        """
        with self._changed:
            received_at_s = None if header.age_s is None else self.now_s() - header.age_s
            rests_since_s = self._resting_since_s if self._had_rested(header.age_s) else None
            if rests_since_s is not None and header.run_interval_s is None and is_unanswered(self._robot):
                self.note_announced(header.reference())  # what is older is stale from now on
                self.wait_for_robot()
            is_bound = rests_since_s == self._resting_since_s and pose_at_rest(self._robot) is not None
            return self._keep(header, pixels, self._robot if is_bound else None, received_at_s)

    def _had_rested(self, age_s: float | None) -> bool:
        """Whether the robot had stood for long enough when imaging received an image; an unknown age is a no.

        An image may wait in imaging, or be sent again: the time of its arrival here is not that of its exposure. Its
        age is that at which imaging published it: the way from there counts as rest, and as part of the delay.
        """
        if age_s is None:
            return False
        return self.now_s() - age_s - self._resting_since_s >= self._image_delay_s

    def note_fetched_frame(self, header: FrameHeader, pixels: NDArray[np.float32]) -> ReceivedFrame:
        """Note an image that was asked for afterwards: where the robot stood when it was made is not known."""
        with self._changed:
            received_at_s = None if header.age_s is None else self.now_s() - header.age_s
            return self._keep(header, pixels, None, received_at_s)

    def _keep(
        self, header: FrameHeader, pixels: NDArray[np.float32], robot: RobotState | None, received_at_s: float | None
    ) -> ReceivedFrame:
        """Pixels that come after their announcement belong to the epoch that began with it: others may be newer."""
        epoch = self._announced.pop(header.sha256, None) or self._begin_epoch(header.reference())
        frame = ReceivedFrame(header, pixels, epoch, robot, received_at_s)
        self._frames[header.sha256] = frame
        while len(self._frames) > self._kept:
            self._frames.popitem(last=False)
        self._changed.notify_all()
        return frame

    def wait_for_frame(self, sha256: str, timeout_s: float) -> ReceivedFrame | None:
        """A kept image, as soon as it is there; None when it does not come."""
        with self._changed:
            self._changed.wait_for(lambda: sha256 in self._frames, timeout_s)
            return self._frames.get(sha256)

    def wait_for_case(self, case_id: str, revision: int, timeout_s: float) -> OpenCase | None:
        """The case in the given revision, as soon as it is known; None when it does not come, or has been left."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._case is not None and _reached(self._case, case_id, revision), timeout_s
            )
            case = self._case
            return case if case is not None and set_up_of(case) == (case_id, revision) else None

    def note_verified(self, sha256s: tuple[str, ...], verified: WireVerification) -> None:
        """Note what the last verification found."""
        with self._changed:
            self._verified = (frozenset(sha256s), verified)

    def verified(self, sha256s: tuple[str, ...]) -> WireVerification | None:
        """What the last verification found, if it was of these images."""
        with self._changed:
            last = self._verified
            return last[1] if last is not None and last[0] == frozenset(sha256s) else None

    @property
    def case(self) -> OpenCase | None:
        """The open case."""
        with self._changed:
            return self._case

    @property
    def robot(self) -> RobotState | None:
        """The newest state of the robot."""
        with self._changed:
            return self._robot

    def wait_for_robot(self) -> None:
        """While the robot's controller does not answer, wait for its next answer: until then its pose is not known."""
        with self._changed:
            self._changed.wait_for(lambda: not is_unanswered(self._robot), SLOW_ANSWER_S)

    @property
    def newest(self) -> ImageReference | None:
        """The newest image, localised or not."""
        with self._changed:
            return self._newest

    @property
    def epoch(self) -> str:
        """The present registration epoch."""
        with self._changed:
            return f"{self.boot_epoch}.{self._counter}"

    def wait_for_another_epoch(self, seen: str | None, timeout_s: float) -> str:
        """The present epoch, as soon as it is another than `seen`, at the latest after `timeout_s`."""
        with self._changed:
            self._changed.wait_for(lambda: self.epoch != seen, timeout_s)
            return self.epoch

    def _begin_epoch(self, image: ImageReference) -> str:
        """A new epoch; the present one for an image that is older than the newest: it makes nothing stale."""
        if self._newest is not None and image.precedes(self._newest):
            return self.epoch
        self._counter += 1
        self._newest = image
        self._changed.notify_all()
        return self.epoch


def _reached(case: OpenCase, case_id: str, revision: int) -> bool:
    return case.context.case_id != case_id or case.context.revision >= revision

"""What registration knows: the open case, the robot, the newest images and what they said. Safe for several threads."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.localise import LocalisationResult, Parts
from services.registration.core.wires.verify import WireVerification
from services.registration.parts import parts_from_json
from shared.geometry.calibration import CArmCalibration
from shared.geometry.hexapod import HexapodPart
from shared.messages.cases import CaseContext
from shared.messages.imaging import FrameHeader
from shared.messages.registration import LocalisationRecord
from shared.messages.robot import MotionState, PlatformPoseMessage, RobotState
from shared.parts.hexapod_file import hexapod_from_json

AT_REST = (MotionState.LOCKED, MotionState.STOPPED)
# A locked robot's encoders repeat to a micrometre; more than this means that it was moved.
POSE_TOLERANCE_MM = 0.01
POSE_TOLERANCE_DEG = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class OpenCase:
    """The open case with its part files read."""

    context: CaseContext
    parts: Parts
    hexapod: HexapodPart

    @staticmethod
    def of(context: CaseContext) -> "OpenCase":
        """Read the part files; raises `PartFileInvalid`."""
        return OpenCase(
            context,
            parts_from_json(context.ring_json.encode(), context.guide_json.encode(), context.nail_json.encode()),
            hexapod_from_json(context.hexapod_json.encode()),
        )


@dataclass(frozen=True, slots=True, eq=False)
class ReceivedFrame:
    """An image as it arrived.

    Attributes
    ----------
    epoch
        Registration epoch that began with it.
    robot
        State of the robot when it was exposed; None when it was not known, or not at rest long enough to tell.
    """

    header: FrameHeader
    pixels: NDArray[np.float32]
    epoch: str
    robot: RobotState | None


@dataclass(frozen=True, slots=True, eq=False)
class LocalisedFrame:
    """An image with all that was found in it; calibration and result are None when the ring was not found."""

    frame: ReceivedFrame
    case: OpenCase
    record: LocalisationRecord
    calibration: CArmCalibration | None
    result: LocalisationResult | None


class Knowledge:
    """Remembers the newest of everything.

    Parameters
    ----------
    boot_epoch
        Of this run of registration: the first half of every registration epoch.
    kept
        How many images are kept.
    image_delay_s
        How long an image may take from its exposure to its arrival here: it is bound to the robot's pose only when the
        robot has stood there for so long.
    clock_s
        Monotonic clock.
    """

    def __init__(self, boot_epoch: str, kept: int, image_delay_s: float, clock_s: Callable[[], float]) -> None:
        self._boot_epoch = boot_epoch
        self._kept = kept
        self._image_delay_s = image_delay_s
        self._clock_s = clock_s
        self._resting_since_s = float("inf")
        self._changed = threading.Condition()
        self._case: OpenCase | None = None
        self._robot: RobotState | None = None
        self._counter = 0
        self._newest_sha256: str | None = None
        self._frames: OrderedDict[str, ReceivedFrame] = OrderedDict()
        self._localised: OrderedDict[str, LocalisedFrame] = OrderedDict()
        self._verified: tuple[frozenset[str], WireVerification] | None = None

    def open_case(self, case: OpenCase | None) -> None:
        """Note the open case, or that none is open; another case or revision begins a new registration epoch."""
        with self._changed:
            before, now = self._case, case
            self._case = case
            if _name(before) != _name(now):
                self._counter += 1
            self._changed.notify_all()

    def note_robot(self, state: RobotState) -> None:
        """Note the newest state of the robot."""
        with self._changed:
            pose, before = pose_at_rest(state), pose_at_rest(self._robot)
            if pose is None:
                self._resting_since_s = float("inf")
            elif before is None or not same_place(before, pose):
                self._resting_since_s = self._clock_s()
            self._robot = state

    def note_announced(self, sha256: str) -> None:
        """Note that imaging has an image. If its pixels have not come, it begins a new epoch all the same."""
        with self._changed:
            if sha256 not in self._frames:
                self._counter += 1
                self._newest_sha256 = sha256
                self._changed.notify_all()

    def note_frame(self, header: FrameHeader, pixels: NDArray[np.float32]) -> ReceivedFrame:
        """Note an image that arrives now: a new epoch begins. The robot stood where it stands, if for long enough."""
        with self._changed:
            rested = self._clock_s() - self._resting_since_s >= self._image_delay_s
            return self._keep(header, pixels, self._robot if rested else None)

    def note_fetched_frame(self, header: FrameHeader, pixels: NDArray[np.float32]) -> ReceivedFrame:
        """Note an image that was asked for afterwards: where the robot stood when it was made is not known."""
        with self._changed:
            return self._keep(header, pixels, None)

    def _keep(self, header: FrameHeader, pixels: NDArray[np.float32], robot: RobotState | None) -> ReceivedFrame:
        self._counter += 1
        self._newest_sha256 = header.sha256
        frame = ReceivedFrame(header, pixels, self._epoch(), robot)
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
            return case if case is not None and _name(case) == (case_id, revision) else None

    def note_localised(self, localised: LocalisedFrame) -> None:
        """Note what an image said."""
        with self._changed:
            self._localised[localised.record.image.sha256] = localised
            while len(self._localised) > self._kept:
                self._localised.pop(self._dispensable())

    def _dispensable(self) -> str:
        """The oldest image that is not the last accepted one with the robot where it stood; else the oldest."""
        places: list[LocalisedFrame] = []
        needed = set()
        for sha256, one in reversed(self._localised.items()):
            accepted = one.record.localisation.verdict == "accepted"
            if accepted and not any(_same_stand(one, other) for other in places):
                places.append(one)
                needed.add(sha256)
        return next((sha256 for sha256 in self._localised if sha256 not in needed), next(iter(self._localised)))

    def localised(self, sha256: str) -> LocalisedFrame | None:
        """What a kept image said, or None."""
        with self._changed:
            return self._localised.get(sha256)

    def accepted_beside(self, frame: LocalisedFrame, apart_from: tuple[str, ...]) -> tuple[LocalisedFrame, ...]:
        """Accepted images with case and robot as they were for another one, in order, without those named by hash."""
        with self._changed:
            return tuple(
                other
                for sha256, other in self._localised.items()
                if sha256 not in apart_from
                and _same_stand(frame, other)
                and other.record.localisation.verdict == "accepted"
            )

    def accepted_elsewhere(self, frame: LocalisedFrame) -> tuple[LocalisedFrame, ...]:
        """Accepted images of the same set-up for which the robot stood elsewhere than for another one, in order."""
        here, setup = frame.record.robot_pose, _name(frame.case)
        if here is None:
            return ()
        with self._changed:
            return tuple(
                other
                for other in self._localised.values()
                if other.record.localisation.verdict == "accepted"
                and other.record.robot_boot_epoch == frame.record.robot_boot_epoch
                and _name(other.case) == setup
                and other.record.robot_pose is not None
                and not same_place(other.record.robot_pose, here)
            )

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

    @property
    def newest_sha256(self) -> str | None:
        """Hash of the newest image, localised or not."""
        with self._changed:
            return self._newest_sha256

    @property
    def epoch(self) -> str:
        """The present registration epoch."""
        with self._changed:
            return self._epoch()

    @property
    def boot_epoch(self) -> str:
        """Names this run of registration."""
        return self._boot_epoch

    def wait_for_another_epoch(self, seen: str | None, timeout_s: float) -> str:
        """The present epoch, as soon as it is another than `seen`, at the latest after `timeout_s`."""
        with self._changed:
            self._changed.wait_for(lambda: self._epoch() != seen, timeout_s)
            return self._epoch()

    def _epoch(self) -> str:
        return f"{self._boot_epoch}.{self._counter}"


def pose_at_rest(robot: RobotState | None) -> PlatformPoseMessage | None:
    """Where the robot stands; None when that is not known or it is not at rest."""
    return robot.pose if robot is not None and robot.state in AT_REST else None


def moved_by(a: PlatformPoseMessage, b: PlatformPoseMessage) -> tuple[float, float]:
    """Greatest difference of two poses along an axis, in mm, and about one, in degrees."""
    apart_mm = max(abs(a.x_mm - b.x_mm), abs(a.y_mm - b.y_mm), abs(a.z_mm - b.z_mm))
    apart_deg = max(abs(a.u_deg - b.u_deg), abs(a.v_deg - b.v_deg), abs(a.w_deg - b.w_deg))
    return apart_mm, apart_deg


def same_place(a: PlatformPoseMessage, b: PlatformPoseMessage) -> bool:
    """Whether two poses are the same as far as encoders can tell."""
    apart_mm, apart_deg = moved_by(a, b)
    return apart_mm <= POSE_TOLERANCE_MM and apart_deg <= POSE_TOLERANCE_DEG


def _same_stand(a: LocalisedFrame, b: LocalisedFrame) -> bool:
    """Whether robot and set-up were the same for two images; where the robot stood must be known for both."""
    here, there = a.record.robot_pose, b.record.robot_pose
    return (
        here is not None
        and there is not None
        and same_place(here, there)
        and a.record.robot_boot_epoch == b.record.robot_boot_epoch
        and _name(a.case) == _name(b.case)
    )


def _name(case: OpenCase | None) -> tuple[str | None, int] | None:
    return None if case is None else (case.context.case_id, case.context.revision)


def _reached(case: OpenCase, case_id: str, revision: int) -> bool:
    return case.context.case_id != case_id or case.context.revision >= revision

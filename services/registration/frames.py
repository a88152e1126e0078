"""Part files as registration reads them, and images as it keeps them: with the case and the robot's pose."""

import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.fusion import ImageResult
from services.registration.core.localise import Parts
from shared.errors import Accepted, Reason, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.hexapod import HexapodPart
from shared.messages.cases import CaseContext
from shared.messages.imaging import CalibrationMessage, FrameHeader
from shared.messages.registration import LocalisationRecord
from shared.messages.robot import MotionState, PlatformPoseMessage, RobotState
from shared.parts.files import guide_from_json, nail_from_json, ring_from_json
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
        ring, guide, nail = (json.encode() for json in (context.ring_json, context.guide_json, context.nail_json))
        parts = parts_from_json(ring, guide, nail, context.drill_diameter_mm)
        return OpenCase(context, parts, hexapod_from_json(context.hexapod_json.encode()))


def parts_from_json(
    ring: bytes,
    guide: bytes,
    nail: bytes,
    drill_diameter_mm: float,
    sources: tuple[str, str, str] = ("ring file", "guide file", "nail file"),
) -> Parts:
    """Parse ring, guide and nail files; raises `PartFileInvalid` when a file breaks its schema."""
    return Parts(
        ring_from_json(ring, sources[0]),
        guide_from_json(guide, sources[1]),
        nail_from_json(nail, sources[2]),
        drill_diameter_mm,
    )


@dataclass(frozen=True, slots=True, eq=False)
class ReceivedFrame:
    """An image as it arrived."""

    header: FrameHeader
    pixels: NDArray[np.float32]
    epoch: str  # registration epoch that began with it
    # state of the robot when it was exposed; None when it was not known, or not at rest for long enough
    robot: RobotState | None
    # when imaging received it, on registration's monotonic clock; None when its age was not known
    received_at_s: float | None = None

    def age_s(self, now_s: float) -> float | None:
        """How long ago imaging received it; None when nobody knows."""
        return None if self.received_at_s is None else max(now_s - self.received_at_s, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class LocalisedFrame:
    """An image with what was found in it."""

    frame: ReceivedFrame
    case: OpenCase
    record: LocalisationRecord
    image: ImageResult  # what the core needs of it; sentences name it by the beginning of its hash


class LocalisedFrames:
    """The last few localised images, and of the present set-up the last accepted one of each place of the robot.

    Thread-safe.
    """

    def __init__(self, kept: int) -> None:
        self._kept = kept
        self._lock = threading.Lock()
        self._frames: OrderedDict[str, LocalisedFrame] = OrderedDict()

    def note(self, localised: LocalisedFrame) -> None:
        """Keep one more; another may have to go."""
        with self._lock:
            self._frames[localised.record.image.sha256] = localised
            while len(self._frames) > self._kept:
                self._frames.pop(self._dispensable())

    def get(self, sha256: str) -> LocalisedFrame | None:
        """A kept image, or None."""
        with self._lock:
            return self._frames.get(sha256)

    def accepted_beside(self, frame: LocalisedFrame) -> tuple[LocalisedFrame, ...]:
        """Accepted images with case and robot as they were for another one, in order; it may be among them."""
        return tuple(other for other in self._accepted() if moved_between(frame, other) is False)

    def accepted_before(self, frames: Sequence[LocalisedFrame]) -> tuple[LocalisedFrame, ...]:
        """Those beside the first of some images that were received before all of them."""
        references = [one.record.image for one in frames]
        beside = self.accepted_beside(frames[0])
        return tuple(other for other in beside if all(other.record.image.precedes(one) for one in references))

    def accepted_elsewhere(self, frame: LocalisedFrame) -> tuple[LocalisedFrame, ...]:
        """Accepted images of the same set-up for which the robot stood elsewhere than for another one, in order."""
        return tuple(other for other in self._accepted() if moved_between(frame, other))

    def _accepted(self) -> list[LocalisedFrame]:
        with self._lock:
            return [one for one in self._frames.values() if one.record.localisation.verdict == "accepted"]

    def _dispensable(self) -> str:
        """The oldest image of a set-up that was left; else the oldest that is not the last accepted one with the robot
        where it stood; else the oldest. Never the newest, which somebody is about to verify.
        """
        *older, newest = self._frames.values()
        left = (one for one in older if set_up_of(one.case) != set_up_of(newest.case))
        if (of_another := next(left, None)) is not None:
            return of_another.record.image.sha256
        needed: list[LocalisedFrame] = []
        for one in reversed(self._frames.values()):
            accepted = one.record.localisation.verdict == "accepted"
            if accepted and not any(moved_between(one, other) is False for other in needed):
                needed.append(one)
        kept = {one.record.image.sha256 for one in needed}
        sha256s = [one.record.image.sha256 for one in older]
        return next((sha256 for sha256 in sha256s if sha256 not in kept), sha256s[0])


def calibration_of(message: CalibrationMessage) -> Accepted[CArmCalibration] | Rejected:
    """What imaging found out about the image."""
    if message.values is None:
        return Rejected(tuple(Reason(reason.code, reason.message) for reason in message.reasons))
    return Accepted(message.values.calibration())


def moved_between(a: LocalisedFrame, b: LocalisedFrame) -> bool | None:
    """Whether the robot stood elsewhere for one of two images; None for two set-ups, or where its place is unknown."""
    here, there = a.record.robot_pose, b.record.robot_pose
    if here is None or there is None or a.record.robot_boot_epoch != b.record.robot_boot_epoch:
        return None
    return None if set_up_of(a.case) != set_up_of(b.case) else not same_place(here, there)


def set_up_of(case: OpenCase | None) -> tuple[str | None, int] | None:
    """Names a set-up: the case and its revision; None without a case."""
    return None if case is None else (case.context.case_id, case.context.revision)


def pose_at_rest(robot: RobotState | None) -> PlatformPoseMessage | None:
    """Where the robot stands; None when that is not known or it is not at rest."""
    return robot.pose if robot is not None and robot.state in AT_REST else None


def is_unanswered(robot: RobotState | None) -> bool:
    """Whether the robot is at rest and its controller has not answered in the last round."""
    return robot is not None and robot.state in AT_REST and robot.pose is None


def moved_by(a: PlatformPoseMessage, b: PlatformPoseMessage) -> tuple[float, float]:
    """Greatest difference of two poses along an axis, in mm, and about one, in degrees."""
    apart_mm = max(abs(a.x_mm - b.x_mm), abs(a.y_mm - b.y_mm), abs(a.z_mm - b.z_mm))
    apart_deg = max(abs(a.u_deg - b.u_deg), abs(a.v_deg - b.v_deg), abs(a.w_deg - b.w_deg))
    return apart_mm, apart_deg


def same_place(a: PlatformPoseMessage, b: PlatformPoseMessage) -> bool:
    """Whether two poses are the same within the encoders' tolerances."""
    apart_mm, apart_deg = moved_by(a, b)
    return apart_mm <= POSE_TOLERANCE_MM and apart_deg <= POSE_TOLERANCE_DEG

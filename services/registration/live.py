"""Guidance while fluoroscopy runs: every calibrated frame is followed, the newest first, none is waited for.

Imaging marks the frames of a run (`ImageReference.run_interval_s`). Single shots are localised in full, one by one; of
a run only its newest frame is, and only when that is due: to begin with, when the track was lost, now and
then as a check, and when the run has ended.
"""

import threading
import time
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager

from services.registration.core.acceptance.criteria import NO_REFERENCE_IMAGE
from services.registration.core.c_arm_advice import CArmAngles
from services.registration.core.guidance.tracking import (
    FrameEstimate,
    NumberedFrame,
    Origin,
    Run,
    Track,
    begin_track,
    track_frame,
)
from services.registration.core.localise import Parts
from services.registration.frames import (
    LocalisedFrame,
    OpenCase,
    ReceivedFrame,
    calibration_of,
    is_unanswered,
    pose_at_rest,
    same_place,
    set_up_of,
)
from services.registration.guidance_report import DisplayRotationMemory, FrameFacts, guidance_message
from services.registration.settings import RegistrationSettings
from services.registration.state import RegistrationState
from shared.bus.port import Bus
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.messages.base import encode
from shared.messages.imaging import CalibrationMessage, ImageReference
from shared.messages.robot import PlatformPoseMessage, RobotState
from shared.runtime.latest import LatestSlot
from shared.runtime.lifecycle import Runtime
from shared.threads import supervised_thread

# How long leaving may wait for this loop.
_WAIT_S = 0.2
# Chosen: a frame whose pixels or case come later is stale for guidance, which wants ten a second.
_PIXELS_S = 0.5
_CASE_S = 0.5
# Chosen: a bound on memory, two minutes at 30 frames/s.
_NUMBERED = 4096


class LiveGuidance:
    """Tracks frames on a thread of its own and publishes the estimate from each."""

    def __init__(self, bus: Bus, runtime: Runtime, settings: RegistrationSettings, state: RegistrationState) -> None:
        self._runtime, self._settings, self._state = runtime, settings, state
        # Not retained: a message that is delivered later would look like that of the present frame.
        self._publisher = bus.publisher(runtime.keys.guidance)
        self._frames: LatestSlot[CalibrationMessage] = LatestSlot()
        self._lock = threading.Lock()
        self._setup: tuple[str | None, int] | None = None
        self._run, self._display = Run(), DisplayRotationMemory()
        self._robot_pose: PlatformPoseMessage | None = None
        self._arrived: OrderedDict[str, int] = OrderedDict()
        self._arrivals = 0
        self._skipped_before = self._unseen = 0
        self._waiting: CalibrationMessage | None = None
        self._newest_at_s = self._localised_at_s = float("-inf")

    @contextmanager
    def running(self) -> Iterator[None]:
        """Follow frames for as long as the context lasts."""
        worker = supervised_thread("guidance", self._work)
        worker.start()
        try:
            yield
        finally:
            self._frames.close()
            worker.join(5.0)

    def takes(self, message: CalibrationMessage) -> bool:
        """Follow this frame; True when it belongs to a run, and need not be localised in full one by one."""
        in_run = message.image.run_interval_s is not None
        with self._lock:
            self._number(message.image.sha256)
            self._newest_at_s = time.monotonic()
            self._waiting = message if in_run else None
            known = self._run.track is not None
        if in_run or known:
            self._frames.put(message)
        return in_run

    def job(self) -> CalibrationMessage | None:
        """The newest frame of a run, when it is due to be localised in full; handed out once."""
        with self._lock:
            message, now_s = self._waiting, time.monotonic()
            if message is None:
                return None
            lost = self._run.track is None or self._run.track.frames_without_estimate > 0
            checked_s_ago = now_s - self._localised_at_s
            ended = now_s - self._newest_at_s > (message.image.run_interval_s or 0.0)
            if not (lost or ended or checked_s_ago > self._settings.live_check_every_s):
                return None
            self._waiting = None
            return message

    def note_localised(self, localised: LocalisedFrame) -> None:
        """Begin anew from an image that was localised in full; publish its estimate if it is still the newest."""
        calibration, found = localised.image.calibration, localised.image.result
        if calibration is None:
            return
        case, record = localised.case, localised.record
        estimate, track = begin_track(localised.frame.pixels, calibration, case.parts, found)
        with self._lock:
            run = self._run_of(case)
            if run is None:
                return
            outcome = run.add_localised(self._numbered(record.image.sha256), estimate, track)
            self._localised_at_s = time.monotonic()
            if outcome.starts_track:
                self._robot_pose = record.robot_pose
            if not outcome.confirms:
                self._display.forget_the_guide()
            if outcome.publish:
                elapsed_ms = record.localisation.timing_ms.total
                self._publish(estimate, record.image, localised.frame, case, calibration, elapsed_ms)
        if outcome.contradicts:
            sha256 = record.image.sha256
            self._runtime.log.warning("guidance disagreed with the full localisation", sha256=sha256)

    def _run_of(self, case: OpenCase) -> Run | None:
        """The run of the present set-up, which begins with it; None for a set-up that has been left."""
        setup = set_up_of(case)
        if setup != set_up_of(self._state.case):
            return None
        if self._setup != setup:
            self._setup = setup
            self._run, self._robot_pose, self._display = Run(), None, DisplayRotationMemory()
        return self._run

    def _number(self, sha256: str) -> None:
        self._arrivals += 1
        self._arrived[sha256] = self._arrivals
        self._arrived.move_to_end(sha256)
        while len(self._arrived) > _NUMBERED:
            self._arrived.popitem(last=False)

    def _numbered(self, sha256: str) -> NumberedFrame:
        """In the order of arrival, for a clock may be set back; one that came too long ago to know is the oldest."""
        return NumberedFrame(sha256, self._arrived.get(sha256, 0))

    def _work(self) -> None:
        while not self._runtime.stop.is_set():
            message = self._frames.take(_WAIT_S)
            if message is None:
                continue
            try:
                self._follow(message)
            except Exception as error:  # the border of a task: the next frame must not suffer from this one
                self._runtime.log.exception("guidance fault", sha256=message.image.sha256)
                impairment = f"a frame brought a fault: {error}; guidance goes on with the next one"
                self._runtime.status.impair("guidance", impairment)
            else:
                self._runtime.status.impair("guidance", None)

    def _follow(self, message: CalibrationMessage) -> None:
        began_s = time.monotonic()
        case = self._state.wait_for_case(message.case_id or "", message.case_revision, _CASE_S)
        frame = self._state.wait_for_frame(message.image.sha256, _PIXELS_S)
        if case is None or frame is None:
            self._unseen += 1  # the set-up has changed, or newer frames have pushed this one out
            return
        if is_unanswered(self._state.robot):
            self._unseen += 1  # whether the guide was moved is not known yet: the track waits for the answer
            return
        with self._lock:
            run = self._run_of(case)
            if run is None:
                self._unseen += 1
                return
            if not _stands_still(self._robot_pose, self._state.robot):
                run.track = None  # the guide was moved against the nail
            start = run.start()
        calibrated = calibration_of(message)
        estimate, after = _estimated(frame, calibrated, case.parts, start.track)
        with self._lock:
            known = self._run_of(case) is run
            if known and run.add_tracked(self._numbered(message.image.sha256), start, estimate, after):
                elapsed_ms = 1e3 * (time.monotonic() - began_s)
                calibration = calibrated.value if isinstance(calibrated, Accepted) else None
                self._publish(estimate, message.image, frame, case, calibration, elapsed_ms)
            else:
                self._unseen += 1

    def _publish(
        self,
        estimate: FrameEstimate,
        image: ImageReference,
        frame: ReceivedFrame,
        case: OpenCase,
        calibration: CArmCalibration | None,
        elapsed_ms: float,
    ) -> None:
        """Publish; the caller holds the lock since it found the frame new, so that no older message follows a newer."""
        header = frame.header
        primary, secondary = header.positioner_primary_angle_deg, header.positioner_secondary_angle_deg
        angles = None if primary is None or secondary is None else CArmAngles(primary, secondary)
        passed_over = self._frames.replaced + self._unseen
        skipped, self._skipped_before = passed_over - self._skipped_before, passed_over
        context = case.context
        case_id, revision, age_s = context.case_id, context.revision, frame.age_s(self._state.now_s())
        facts = FrameFacts(image, case_id, revision, angles, calibration, skipped, elapsed_ms, age_s)
        self._publisher.put(encode(guidance_message(estimate, facts, self._display)))


def _estimated(
    frame: ReceivedFrame, calibrated: Accepted[CArmCalibration] | Rejected, parts: Parts, track: Track | None
) -> tuple[FrameEstimate, Track | None]:
    if isinstance(calibrated, Rejected):
        return FrameEstimate(Origin.FOLLOWED, None, None, calibrated.reasons, None), track
    if track is None:
        return FrameEstimate(Origin.FOLLOWED, None, None, (NO_REFERENCE_IMAGE.reason(),), None), None
    return track_frame(frame.pixels, calibrated.value, parts, track)


def _stands_still(reference: PlatformPoseMessage | None, robot: RobotState | None) -> bool:
    """Whether the robot stands where it stood for the reference image; where it stood is unknown while it moves."""
    if robot is None:  # there is none: nothing moves the guide
        return reference is None
    now = pose_at_rest(robot)
    return reference is not None and now is not None and same_place(reference, now)

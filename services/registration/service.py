"""Registration: frame and calibration in, localisation out; plans and verifications on request. No mathematics here."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from services.registration.core.wires.verify import verify_guide_alone, verify_images
from services.registration.frames import (
    LocalisedFrame,
    OpenCase,
    ReceivedFrame,
    set_up_of,
)
from services.registration.image_report import localised_frame
from services.registration.jobs import LocalisationJobs
from services.registration.live import LiveGuidance
from services.registration.planning import another_set_up, answer_plan_request, stood_elsewhere
from services.registration.report import verification_message
from services.registration.settings import RegistrationSettings
from services.registration.state import SLOW_ANSWER_S, RegistrationState
from shared.bus.frame_paths import FramePaths
from shared.bus.port import Answer, Bus, Query, Sample, Subscription
from shared.errors import BusError, InputError
from shared.messages.base import decode, encode
from shared.messages.cases import CaseContext
from shared.messages.imaging import CalibrationMessage, FrameHeader
from shared.messages.registration import (
    PlanRequest,
    RegistrationEpoch,
    VerificationReply,
    VerificationRequest,
)
from shared.messages.robot import RobotState
from shared.messages.stored_images import LocalisationRequest
from shared.runtime.impairments import is_lack_of_memory
from shared.runtime.lifecycle import Runtime
from shared.threads import supervised_thread

# How long leaving may wait for this loop.
_WAIT_S = 0.2
# Five times within the second after which the robot refuses (`registration_silent`).
_EPOCH_EVERY_S = 0.2
_CASE_TIMEOUT_S = 2.0
# Chosen: pixels travel on another key than their calibration, and come a little later at most, or wait for the robot.
_OVERTAKEN_S = SLOW_ANSWER_S + 0.3


class RegistrationService:
    """Localises in the newest image of an open case, and plans from it."""

    def __init__(self, bus: Bus, runtime: Runtime, settings: RegistrationSettings, state: RegistrationState) -> None:
        self._bus = bus
        self._runtime = runtime
        self._settings = settings
        self._state = state
        self._jobs = LocalisationJobs(state)
        self._localisations = bus.retained_publisher(runtime.keys.localisation)
        self._plans = bus.retained_publisher(runtime.keys.plan)
        # Not retained: a value that is delivered later would look as if it were confirmed now.
        self._epochs = bus.publisher(runtime.keys.registration_epoch)
        self._left = threading.Event()
        self._paths, self._tcp_was_logged = FramePaths(), False
        self._guidance = LiveGuidance(bus, runtime, settings, state)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Listen, work and answer for as long as the context lasts."""
        with ExitStack() as stack:
            stack.enter_context(self._guidance.running())
            worker = supervised_thread("localise", self._work)
            worker.start()
            stack.callback(worker.join, 5.0)
            stack.callback(self._jobs.close)
            epochs = supervised_thread("epoch", self._publish_epochs)
            epochs.start()
            stack.callback(epochs.join, 5.0)
            stack.callback(self._left.set)
            for declared in self.listen():
                stack.callback(declared.close)
            yield

    def listen(self) -> tuple[Subscription, ...]:
        """Subscribe, and answer queries; images wait for `next_image`."""
        keys, bus = self._runtime.keys, self._bus
        return (
            bus.subscribe_retained(keys.robot_state, self._on_robot),
            bus.subscribe_retained(keys.case_context, self._on_case),
            bus.subscribe(keys.frame, self._on_frame),
            bus.subscribe_retained(keys.calibration, self._on_calibration),
            bus.queryable(keys.plan_request, self._on_plan_request),
            bus.queryable(keys.localisation_request, self._on_localisation_request),
            bus.queryable(keys.verification_request, self._on_verification_request),
        )

    def _on_robot(self, sample: Sample) -> None:
        self._state.note_robot(decode(RobotState, sample.payload))

    def _on_case(self, sample: Sample) -> None:
        context = decode(CaseContext, sample.payload)
        self._jobs.unusable_case = ""
        if context.case_id is None:
            self._state.open_case(None)
            self._runtime.ready()
            return
        try:
            self._state.open_case(OpenCase.of(context))
        except InputError as error:
            self._jobs.unusable_case = str(error)
            self._state.open_case(None)
            self._runtime.degraded(f"case '{context.case_id}' cannot be used: {error}; correct the file in the case")
            return
        self._runtime.ready()

    def _on_frame(self, sample: Sample) -> None:
        self._note_path(sample)
        header = decode(FrameHeader, sample.attachment)
        self._state.note_frame(header, header.pixels(sample.payload))

    def _note_path(self, sample: Sample) -> None:
        """Say it once when frames begin to come by TCP."""
        self._paths.note(sample)
        if self._paths.fallen_back and not self._tcp_was_logged:
            detail = f"{self._paths.sentence}: imaging and this service share no memory; see `no shared memory` there"
            self._runtime.log.warning("frames come by TCP", detail=detail)
        self._tcp_was_logged = self._paths.fallen_back

    def _on_calibration(self, sample: Sample) -> None:
        message = decode(CalibrationMessage, sample.payload)
        self._state.note_announced(message.image)
        if message.case_id is None or self._guidance.takes(message):
            return
        superseded = self._jobs.put(message)
        if superseded is not None:
            self._runtime.log.warning("image superseded by a newer one", sha256=superseded)

    def _on_localisation_request(self, query: Query) -> Answer:
        """Whoever has an image on record without a localisation asks for it."""
        request = decode(LocalisationRequest, query.payload)
        reply = self._jobs.reply(request)
        if reply.skip is not None:
            sha256 = request.calibration.image.sha256
            self._runtime.log.warning("image not localised", sha256=sha256, detail=reply.skip.message)
        return Answer(encode(reply))

    def _on_plan_request(self, query: Query) -> Answer:
        request = decode(PlanRequest, query.payload)
        self._state.wait_for_robot()
        reply = answer_plan_request(request, self._state, self._settings.oldest_image_s)
        if reply.plan is not None:
            # published before it is answered: the robot must know a plan before anyone can approve it
            self._plans.put(encode(reply.plan))
        self._runtime.log.info("plan requested", verdict=reply.verdict, code=reply.code, detail=reply.message)
        return Answer(encode(reply))

    def _on_verification_request(self, query: Query) -> Answer:
        request = decode(VerificationRequest, query.payload)
        self._state.wait_for_robot()
        found = [self._state.images.get(sha256) for sha256 in request.image_sha256]
        case = self._state.case
        # what is in the holes changes between two images of one set-up
        known = [f for f in found if f is not None and set_up_of(f.case) == set_up_of(case)]
        if case is None or case.context.case_id != request.case_id or len(known) < len(found):
            return Answer(encode(VerificationReply(code="unknown_image", message=self._why_unknown(request, known))))
        against = _not_one_set_up(known) or _not_of_now(known, self._state.robot)
        if against is not None:
            return Answer(encode(against))
        earlier = self._state.images.accepted_before(known)
        images, before = tuple(one.image for one in known), tuple(one.image for one in earlier)
        if request.of == "guide":
            verified = verify_guide_alone(images, before, case.parts)
        else:
            verified = verify_images(images, before, case.parts, self._settings.wire_diameter_mm)
            self._state.note_verified(request.image_sha256, verified)
        verification = verification_message(request.image_sha256, verified, request.of)
        return Answer(encode(VerificationReply(verification=verification)))

    def _why_unknown(self, request: VerificationRequest, known: list[LocalisedFrame]) -> str:
        for sha256 in request.image_sha256:
            if self._jobs.is_in_hand(sha256):
                return f"image {sha256[:12]} is being localised; verify it when its localisation is on record"
        count = len(request.image_sha256)
        return (
            f"{count - len(known)} of the {count} images were not localised under the present set-up of case "
            f"'{request.case_id}' since registration started; take them again"
        )

    def _publish_epochs(self) -> None:
        """Publish the newest epoch: at every change, and steadily: silence then means that nothing is confirmed."""
        epoch, sequence = None, 0
        while not self._left.is_set():
            epoch = self._state.wait_for_another_epoch(epoch, _EPOCH_EVERY_S)
            message = RegistrationEpoch(boot_epoch=self._state.boot_epoch, sequence=sequence, registration_epoch=epoch)
            self._epochs.put(encode(message))
            sequence += 1

    def _work(self) -> None:
        """Localise in the newest image that waits."""
        while not self._runtime.stop.is_set():
            job = self.next_image(_WAIT_S) or self._guidance.job()
            if job is None:
                continue
            fault, impairment = None, None
            try:
                self.localise(job)
            except BusError as error:  # imaging is gone, or its link: whoever has the image on record asks again
                self._runtime.log.error("image not localised", sha256=job.image.sha256, detail=str(error))  # noqa: TRY400
                impairment = f"image {job.image.sha256[:12]} was not localised: {error}; check imaging"
            except Exception as error:  # noqa: BLE001 - the border of a task: the next image must not suffer from this one
                fault, impairment = self._fault_of(job, error)
            self._runtime.status.impair("localisation", impairment)
            self._jobs.done(fault)

    def _fault_of(self, job: CalibrationMessage, error: Exception) -> tuple[str | None, str]:
        """What the image brought, None where it was the process's memory that failed, and what impairs the service."""
        if is_lack_of_memory(error):  # the image is asked for again
            self._runtime.log.error("image not localised", sha256=job.image.sha256, detail=str(error))
            return None, f"image {job.image.sha256[:12]} waits for memory ({error}); raise the limit of memory"
        self._runtime.log.exception("fault", sha256=job.image.sha256)
        return str(error), f"image {job.image.sha256[:12]} brought a fault: {error}; take another image"

    def next_image(self, timeout_s: float) -> CalibrationMessage | None:
        """Wait up to `timeout_s` for the calibration of the next image, which is in work until another is asked for."""
        return self._jobs.take(timeout_s)

    def localise(self, job: CalibrationMessage) -> None:
        """Localise in an image, and publish what was found; raises `BusError` when its pixels cannot be had."""
        assert job.case_id is not None  # `_on_calibration` queues no others
        case = self._state.wait_for_case(job.case_id, job.case_revision, _CASE_TIMEOUT_S)
        if case is None or job.ring_sha256 not in (None, case.parts.ring.sha256):
            self._runtime.log.warning(
                "image not localised: its case's set-up is not the present one",
                sha256=job.image.sha256,
                case=job.case_id,
                revision=job.case_revision,
            )
            return
        # pixels travel on a key of their own and may be overtaken by the much smaller calibration
        frame = self._state.wait_for_frame(job.image.sha256, _OVERTAKEN_S) or self._fetched(job.image.sha256)
        localised = localised_frame(frame, job, case, self._state.now_s)
        self._state.images.note(localised)
        self._localisations.put(encode(localised.record))
        self._guidance.note_localised(localised)
        found = localised.record.localisation
        self._runtime.log.info(
            "localised",
            sha256=job.image.sha256,
            verdict=found.verdict,
            reasons=[reason.message for reason in found.reasons],
            total_ms=found.timing_ms.total,
        )

    def _fetched(self, sha256: str) -> ReceivedFrame:
        """Ask imaging for an image whose pixels did not arrive; raises `BusError` when it has none."""
        key = self._runtime.keys.frame_by_hash(sha256)
        try:
            answer = self._bus.query(key, b"", self._settings.frame_timeout_s)
        except BusError as error:
            raise BusError(f"the pixels of image {sha256[:12]} were missed and cannot be fetched: {error}") from error
        header = decode(FrameHeader, answer.attachment)
        return self._state.note_fetched_frame(header, header.pixels(answer.payload))


def _not_of_now(frames: list[LocalisedFrame], robot: RobotState | None) -> VerificationReply | None:
    """Why images do not show where the guide is now, or None."""
    for frame in frames:
        elsewhere = stood_elsewhere(frame, robot)
        if elsewhere is not None:
            named = f"image {frame.record.image.sha256[:12]} cannot be verified: {elsewhere}"
            return VerificationReply(code="stale", message=f"{named}; take an image and verify it")
    return None


def _not_one_set_up(frames: list[LocalisedFrame]) -> VerificationReply | None:
    """Why images may not be verified together, or None."""
    hashes = [frame.record.image.sha256 for frame in frames]
    if len(set(hashes)) < len(hashes):
        message = f"{len(hashes)} images were named and {len(set(hashes))} differ; name each once"
        return VerificationReply(code="image_twice", message=message)
    for other in frames[1:]:
        why = another_set_up(other, frames[0])
        if why is not None:
            message = f"image {other.record.image.sha256[:12]} shows another set-up: {why}; take both again"
            return VerificationReply(code="another_set_up", message=message)
    return None

"""The other services as the gateway meets them on the bus, written by hand and under the test's control."""

import itertools
import threading
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Self

from services.ui_api.core.events import Event
from services.ui_api.record.record import CaseRecord
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Answer, Query
from shared.errors import ReasonCode
from shared.messages.base import MessageInvalid, decode, encode
from shared.messages.imaging import FrameHeader
from shared.messages.presence import ServiceName
from shared.messages.qa import QaRequest
from shared.messages.registration import (
    LocalisationRecord,
    PlanReply,
    PlanRequest,
    VerificationReply,
    VerificationRequest,
)
from shared.messages.robot import (
    CommandReply,
    MotionState,
    MoveCommand,
    PlainCommand,
    RobotState,
    StopCommand,
    StopLatch,
    StopReport,
)
from shared.messages.stored_images import (
    LocalisationReply,
    LocalisationRequest,
    Skip,
    StoredImage,
    StoredImagesReply,
    StoredImagesRequest,
)
from shared.runtime.presence import StatusReporter, beating
from tests.unit.services.ui_api import samples

PATIENCE_S = 60.0
_stores = itertools.count(1)
HEARTBEAT_HZ = 5.0


class OnTheBus:
    """Something with a bus session of its own."""

    def __init__(self, router: MemoryRouter, keys: Keys) -> None:
        self.bus = router.open()
        self.keys = keys
        self._presence = ExitStack()

    def appear(self, service: ServiceName, boot_epoch: str = "boot-1") -> None:
        """Be there as a service is: with token, heartbeats, and the report that it is ready."""
        self._presence.enter_context(beating(self.bus, self.keys, service, boot_epoch, HEARTBEAT_HZ))
        self.status = StatusReporter(self.bus.retained_publisher(self.keys.status(service)), service, boot_epoch, "1")
        self.status.report("ready")

    def fall_silent(self) -> None:
        """Send no more heartbeats, and lose the token."""
        self._presence.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._presence.close()
        self.bus.__exit__(kind, error, trace)


class FakeImaging(OnTheBus):
    """Publishes frames and hands out their pixels."""

    def __init__(self, router: MemoryRouter, keys: Keys) -> None:
        super().__init__(router, keys)
        self._frames = self.bus.publisher(keys.frame)
        self._headers: dict[str, FrameHeader] = {}
        self.silent, self.asked_in_vain = False, threading.Event()
        self.store_id = f"store-{next(_stores)}"
        self.stored: list[StoredImage] = []
        self.bus.queryable(keys.any_frame_by_hash, self._frame)
        self.bus.queryable(keys.stored_images, self._stored_images)
        self.bus.queryable(keys.any_calibration_of, self._calibration)
        self.bus.queryable(keys.qa_request, self._quality)
        self.appear("imaging")

    def send(self, name: str, case_id: str | None, revision: int = 1) -> FrameHeader:
        header = self.store(name, case_id, revision)
        self.publish(header)
        return header

    def publish(self, header: FrameHeader) -> None:
        self._frames.put(samples.pixels(), encode(header))

    def store(self, name: str, case_id: str | None, revision: int = 1, calibration: str = "pending") -> FrameHeader:
        """Have an image without publishing it, as if the bus had dropped the frame, or nobody had listened."""
        header = samples.frame_header(name, case_id, revision, len(self.stored) + 1)
        header = header.model_copy(update={"store_id": self.store_id})
        self.keep(header, calibration)
        return header

    def keep(self, header: FrameHeader, calibration: str = "pending", skip: Skip | None = None) -> None:
        """Have this very image, the next by its number, or say something else of its calibration."""
        self._headers[header.sha256] = header
        one = StoredImage.model_validate({"header": header, "calibration": calibration, "skip": skip})
        self.stored[header.sequence - 1 : header.sequence] = [one]

    def _stored_images(self, query: Query) -> Answer:
        if self.silent:
            self.asked_in_vain.set()
            raise MessageInvalid("imaging is of another version")
        request = decode(StoredImagesRequest, query.payload)
        images = tuple(self.stored[request.after : request.after + request.most])
        return Answer(encode(StoredImagesReply(store_id=self.store_id, newest=len(self.stored), images=images)))

    def _calibration(self, query: Query) -> Answer:
        header = self.stored[int(query.key.rsplit("/", 1)[-1]) - 1].header
        return Answer(encode(samples.calibration(header)))

    def _quality(self, query: Query) -> Answer:
        return Answer(encode(samples.qa_reply(decode(QaRequest, query.payload))))

    def _frame(self, query: Query) -> Answer:
        header = self._headers[query.key.rsplit("/", 1)[-1]]
        return Answer(samples.pixels(), encode(header))


class FakeRegistration(OnTheBus):
    """Publishes localisations, and answers plan and verification requests; `refusal` makes it refuse."""

    def __init__(self, router: MemoryRouter, keys: Keys) -> None:
        super().__init__(router, keys)
        self._localisations = self.bus.retained_publisher(keys.localisation)
        self._guidance = self.bus.publisher(keys.guidance)
        self.count = 0
        self.plan_requests: list[PlanRequest] = []
        self.refusal: tuple[str, str] | None = None
        self.chance_to_pass = 0.999
        self.hold = threading.Event()
        self.hold.set()
        self.asked = threading.Event()
        self.bus.queryable(keys.plan_request, self._plan)
        self.bus.queryable(keys.verification_request, self._verify)
        self.replies: dict[str, LocalisationReply] = {}
        self.localisation_requests: list[LocalisationRequest] = []
        self.bus.queryable(keys.localisation_request, self._localise)
        self.appear("registration")

    def publish(self, header: FrameHeader, *reasons: ReasonCode) -> LocalisationRecord:
        self.count += 1
        record = samples.localisation_record(header, f"registration-1.{self.count}", *reasons)
        self._localisations.put(encode(record))
        return record

    def guide(self, header: FrameHeader, about_image_x_deg: float) -> None:
        """Say how to turn the C-arm, from one frame."""
        self._guidance.put(encode(samples.guidance(header, about_image_x_deg)))

    def repeat(self, record: LocalisationRecord) -> None:
        """Publish the same record again, as the bus does for late joiners."""
        self._localisations.put(encode(record))

    def _plan(self, query: Query) -> Answer:
        request = decode(PlanRequest, query.payload)
        self.plan_requests.append(request)
        self.asked.set()
        self.hold.wait(PATIENCE_S)
        if self.refusal is not None:
            code, message = self.refusal
            return Answer(encode(PlanReply(verdict="rejected", code=code, message=message)))
        return Answer(encode(PlanReply(verdict="accepted", plan=samples.plan(request, f"registration-1.{self.count}"))))

    def _localise(self, query: Query) -> Answer:
        request = decode(LocalisationRequest, query.payload)
        self.localisation_requests.append(request)
        return Answer(encode(self.replies.get(request.calibration.image.sha256, LocalisationReply())))

    def _verify(self, query: Query) -> Answer:
        request = decode(VerificationRequest, query.payload)
        self.asked.set()
        self.hold.wait(PATIENCE_S)
        if self.refusal is not None:
            code, message = self.refusal
            return Answer(encode(VerificationReply(code=code, message=message)))
        return Answer(
            encode(
                VerificationReply(
                    verification=samples.verification(request.image_sha256, request.of, self.chance_to_pass)
                )
            )
        )


class FakeRobot(OnTheBus):
    """Publishes the states it is told to, counts commands, and answers as told: `reply_to_moves` may also hang."""

    def __init__(self, router: MemoryRouter, keys: Keys) -> None:
        super().__init__(router, keys)
        self._states = self.bus.retained_publisher(keys.robot_state)
        self.state = samples.robot_state(1)
        self.moves: list[MoveCommand] = []
        self.plain: list[PlainCommand] = []
        self.stops: list[StopCommand] = []
        self.moved = threading.Event()
        self.stopped = threading.Event()
        self.answers_moves: Callable[[MoveCommand], CommandReply] = self._accept_move
        self.answers_stops = CommandReply(
            command_id=None,
            verdict="accepted",
            state=MotionState.STOPPED,
            stop=StopReport(written=True, standstill=True, locked=True),
        )
        self.release = threading.Event()
        self.plain_is_held = False
        self.bus.queryable(keys.robot_command("move"), self._move)
        self.bus.queryable(keys.robot_command("stop"), self._stop)
        for verb in ("reference", "acknowledge_stop", "reset"):
            self.bus.queryable(keys.robot_command(verb), self._plain)
        self.appear("robot")
        self._states.put(encode(self.state))

    def say(self, state: MotionState, **changes: object) -> RobotState:
        """Publish a next state."""
        kept = {"command_id": self.state.command_id, "outcome": self.state.outcome, "stop": self.state.stop}
        at_ns = {"boot_epoch": self.state.boot_epoch, "clock_s": (self.state.clock_s or 0.0) + 0.02}
        self.state = samples.robot_state(self.state.sequence + 1, state, **(at_ns | kept | changes))
        self._states.put(encode(self.state))
        return self.state

    def arrive(self) -> None:
        """End the move at its target."""
        self.say(MotionState.LOCKED, outcome="reached", deviation_mm=0.01, deviation_deg=0.02)

    def hang(self, command: MoveCommand) -> CommandReply:
        """Answer to no move before `release`."""
        self.release.wait(PATIENCE_S)
        return self._accept_move(command)

    def _accept_move(self, command: MoveCommand) -> CommandReply:
        command_id = command.envelope.command_id
        self.say(MotionState.MOVING, command_id=command_id, outcome="moving")
        return CommandReply(command_id=command_id, verdict="accepted", state=MotionState.MOVING)

    def _move(self, query: Query) -> Answer:
        command = decode(MoveCommand, query.payload)
        self.moves.append(command)
        self.moved.set()
        return Answer(encode(self.answers_moves(command)))

    def _plain(self, query: Query) -> Answer:
        command = decode(PlainCommand, query.payload)
        self.plain.append(command)
        if self.plain_is_held:
            self.release.wait(PATIENCE_S)
        reply = CommandReply(command_id=command.envelope.command_id, verdict="accepted", state=self.state.state)
        return Answer(encode(reply))

    def _stop(self, query: Query) -> Answer:
        self.stops.append(decode(StopCommand, query.payload))
        self.stopped.set()
        if self.state.state is MotionState.MOVING:
            self.say(MotionState.STOPPED, stop=StopLatch.LATCHED, outcome="stopped")
        return Answer(encode(self.answers_stops))


class LogWatch:
    """Waits until something is in the log, woken by the record itself."""

    def __init__(self, record: CaseRecord) -> None:
        self._grown = threading.Condition()
        self._record = record
        record.listen(lambda _: self._notify())

    def wait_for(self, holds: Callable[[], bool]) -> None:
        """Wait until a condition on the ledger holds."""
        with self._grown:
            if not self._grown.wait_for(holds, PATIENCE_S):
                kinds = [e.kind.value for e in self._record.events_after(0)]
                raise AssertionError(f"it did not come about within {PATIENCE_S} s; the log has {kinds}")

    def wait_for_event(self, matches: Callable[[Event], bool]) -> None:
        """Wait until an event of the log matches."""
        self.wait_for(lambda: any(matches(e) for e in self._record.events_after(0)))

    def _notify(self) -> None:
        with self._grown:
            self._grown.notify_all()

"""The four services of an installation in one process, with their own messages, in time that passes only when told to.

Robot service, guard, drive and driver down to the bytes of the virtual controller; registration's handlers and all of
its mathematics; imaging's calibration; the gateway's handlers on a case record of their own. What is left out is what
has tests and benchmarks with real processes: DICOM, HTTP and users, TLS, threads, queues, live guidance.
"""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Final, ParamSpec, TypeVar, cast

import numpy as np
import structlog
from numpy.typing import NDArray

from benchmarks.robot.rig import KEYS, SIGNER, Rig
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_tracking import calibrate_next
from services.imaging.service.wire import calibration_message
from services.registration.service import RegistrationService
from services.registration.settings import RegistrationSettings
from services.registration.state import RegistrationState
from services.ui_api.core.case import Case
from services.ui_api.core.identity import Approver, Authenticated
from services.ui_api.handlers.bus_refusals import BusRefusalLog
from services.ui_api.handlers.cases import CaseHandler
from services.ui_api.handlers.commands import CommandHandler
from services.ui_api.handlers.context import ContextHandler
from services.ui_api.handlers.inbox import Inbox
from services.ui_api.handlers.leases import Leases
from services.ui_api.handlers.permits import PermitHandler
from services.ui_api.handlers.planning import PlanningHandler
from services.ui_api.handlers.procedure import ProcedureHandler
from services.ui_api.handlers.robot_view import RobotView
from services.ui_api.handlers.stop import StopHandler
from services.ui_api.handlers.verification import VerificationHandler
from services.ui_api.record.database import open_database
from services.ui_api.record.record import CaseRecord
from shared.errors import Accepted
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import RingPart
from shared.messages.base import encode
from shared.messages.imaging import FrameHeader
from shared.runtime.clock import Clock
from shared.runtime.lifecycle import Runtime, software_version
from shared.runtime.presence import StatusReporter
from simulation.scenario.c_arm_angles import CArmAngles

_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")
WHO: Final = Approver("surgeon", Authenticated.PASSWORD)
_STORE: Final = "store"
# Chosen: as a C-arm's image arrives, well within registration's `image_delay_s`.
_ARRIVES_AFTER_S: Final = 0.2
_STALE_AFTER_S: Final = 1.0
_IMAGES_HELD: Final = 64
_S_TO_NS: Final = 1e9


class _Sender(Executor):
    """Commands that wait to be sent; they are sent when the transaction that recorded them has ended."""

    def __init__(self) -> None:
        self._waiting: list[Callable[[], None]] = []

    def submit(self, fn: Callable[_Given, _Result], /, *args: _Given.args, **kwargs: _Given.kwargs) -> Future[_Result]:
        """Keep a command."""
        sending: Future[_Result] = Future()

        def send() -> None:
            try:
                sending.set_result(fn(*args, **kwargs))
            except Exception as error:
                sending.set_exception(error)
                raise

        self._waiting.append(send)
        return sending

    def send(self) -> None:
        """Send what waits, in order."""
        while self._waiting:
            self._waiting.pop(0)()


class System:
    """The services, and what a console could ask of the gateway.

    Parameters
    ----------
    rig
        The robot service with its controller; its bus is everybody's.
    folder
        For the case record.
    """

    def __init__(self, rig: Rig, folder: Path) -> None:
        self.rig, self.bus = rig, rig.bus
        self._shots = 0
        self._calibrations: dict[CArmAngles, CArmCalibration] = {}
        clock = Clock(lambda: int(rig.clock() * _S_TO_NS), rig.clock)
        self.registration_state = RegistrationState(rig.registration_boot, _IMAGES_HELD, 0.5, rig.clock)
        settings = RegistrationSettings.model_construct()
        self._registration = RegistrationService(
            self.bus, _runtime(rig, "registration"), settings, self.registration_state
        )
        self.record = CaseRecord(open_database(f"sqlite:///{folder / 'record.sqlite'}"), clock.unix_ns, _IMAGES_HELD)
        self.view = RobotView(clock, _STALE_AFTER_S)
        self.stops = StopHandler(self.bus, KEYS, "gateway")
        permits = PermitHandler(self.record, SIGNER)
        leases = Leases(clock, 1.0, lambda _: None)
        self._sender = _Sender()
        self.commands = CommandHandler(
            self.bus, KEYS, self.record, self.view, self.stops, leases, clock, permits, sender=self._sender
        )
        context = ContextHandler(self.bus, KEYS, self.record)
        self.procedure = ProcedureHandler(self.record, self.view)
        self.cases = CaseHandler(self.record, context.announce, lambda: None, lambda _: True, self.procedure)
        self.planning = PlanningHandler(self.bus, KEYS, self.record, self.procedure, self.commands)
        self.verifications = VerificationHandler(self.bus, KEYS, self.record, self.procedure)
        log = structlog.stdlib.get_logger("distalock.campaign")
        self._inbox = Inbox(
            self.bus, KEYS, self.record, self.view, self.commands, BusRefusalLog(clock), log, _IMAGES_HELD
        )
        # the work that this makes is done by `settle`
        self._registration.listen()
        self._inbox.listen()

    def settle(self) -> None:
        """Do what waits: send commands, localise images, record what came in."""
        self._sender.send()
        while (job := self._registration.next_image(0.0)) is not None:
            self._registration.localise(job)
        while (work := self._inbox.next_work(0.0)) is not None:
            work()
        if self.rig.epoch != self.registration_state.epoch:  # registration says so at once, as after every change
            self.rig.epoch = self.registration_state.epoch
            self.rig.give_signs_of_life()

    def receive(
        self, pixels: NDArray[np.float32], ring: RingPart, nominal: NominalGeometry, side: str, angles: CArmAngles
    ) -> str:
        """An image arrives: imaging publishes it with its calibration, registration localises; its hash.

        Imaging looks for the ring where it was at the same angles of the C-arm, as it does in an installation.
        """
        self._shots += 1
        case = self.open_case
        header = _header(self._shots, pixels, nominal, side, case)
        self.bus.publisher(KEYS.frame).put(np.ascontiguousarray(pixels, dtype="<f4").tobytes(), encode(header))
        outcome = calibrate_next(pixels, ring, nominal, self._calibrations.get(angles))
        if isinstance(outcome, Accepted):
            self._calibrations[angles] = outcome.value
        self.bus.publisher(KEYS.calibration).put(encode(calibration_message(outcome, 1.0, ring, header)))
        self.settle()
        return header.sha256

    @property
    def open_case(self) -> Case:
        """The open case, as the record has it."""
        case = self.record.ledger.open_case()
        assert case is not None
        return case

    def close(self) -> None:
        """The service ends, and so does the record."""
        self.rig.leave()
        self.record.close()


def _runtime(rig: Rig, service: str) -> Runtime:
    publisher = rig.bus.publisher(KEYS.status("registration"))
    status = StatusReporter(publisher, "registration", "reg1", software_version())
    return Runtime("registration", "reg1", KEYS, structlog.stdlib.get_logger(f"distalock.{service}"), status)


def _header(number: int, pixels: NDArray[np.float32], nominal: NominalGeometry, side: str, case: Case) -> FrameHeader:
    rows, columns = pixels.shape
    return FrameHeader.model_validate(
        {
            "sha256": f"{number:064x}",
            "sop_instance_uid": f"1.2.{number}",
            "sequence": number,
            "boot_epoch": "imaging1",
            "received_at_ns": number,
            "width_px": int(cast("int", columns)),
            "height_px": int(cast("int", rows)),
            "bits_stored": 16,
            "case_id": case.case_id,
            "case_revision": case.revision,
            "nominal_source_to_detector_mm": nominal.source_to_detector_mm,
            "nominal_pixel_mm": nominal.pixel_mm,
            "laterality": side,
            "store_id": _STORE,
            "age_s": _ARRIVES_AFTER_S,
        }
    )

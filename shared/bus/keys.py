"""The key space: `distalock/v1/{room}/{service}/...`. Written once, here."""

from dataclasses import dataclass

from shared.messages.presence import ServiceName
from shared.robot_states import Verb

PREFIX = "distalock/v1"


@dataclass(frozen=True, slots=True)
class Keys:
    """Keys of one operating room."""

    room: str

    def _key(self, *parts: str) -> str:
        return "/".join((PREFIX, self.room, *parts))

    @property
    def frame(self) -> str:
        """Raw pixels with a `FrameHeader` as attachment; publish, newest wins."""
        return self._key("imaging", "frame")

    def frame_by_hash(self, sha256: str) -> str:
        """Query: the same pixels and header, by the image's hash, so that no single shot is lost."""
        return self._key("imaging", "frames", sha256)

    @property
    def any_frame_by_hash(self) -> str:
        """What imaging declares its frame queryable on."""
        return self._key("imaging", "frames", "*")

    @property
    def calibration(self) -> str:
        """`CalibrationMessage`; last value kept."""
        return self._key("imaging", "calibration")

    @property
    def stored_images(self) -> str:
        """Query with a `StoredImagesRequest`, answered by a `StoredImagesReply`."""
        return self._key("imaging", "command", "stored_images")

    def calibration_of(self, sequence: int) -> str:
        """Query: the `CalibrationMessage` of an image, by its number in the image store."""
        return self._key("imaging", "calibrations", str(sequence))

    @property
    def any_calibration_of(self) -> str:
        """What imaging declares its calibration queryable on."""
        return self._key("imaging", "calibrations", "*")

    @property
    def qa_request(self) -> str:
        """Query with a `QaRequest`, answered by a `QaReply`."""
        return self._key("imaging", "command", "qa")

    @property
    def localisation(self) -> str:
        """`LocalisationRecord`; last value kept."""
        return self._key("registration", "localisation")

    @property
    def guidance(self) -> str:
        """`Guidance` of a frame of running fluoroscopy; its age counts, so none is kept."""
        return self._key("registration", "guidance")

    @property
    def registration_epoch(self) -> str:
        """`RegistrationEpoch`: at every change and at a steady rate; its age counts, so none is kept."""
        return self._key("registration", "epoch")

    @property
    def localisation_request(self) -> str:
        """Query with a `LocalisationRequest`, answered by a `LocalisationReply`."""
        return self._key("registration", "command", "localise")

    @property
    def plan(self) -> str:
        """`Plan`; last value kept. The robot knows plans from here, not from the gateway."""
        return self._key("registration", "plan")

    @property
    def plan_request(self) -> str:
        """Query with a `PlanRequest`, answered by a `PlanReply`."""
        return self._key("registration", "command", "plan")

    @property
    def verification_request(self) -> str:
        """Query with a `VerificationRequest`, answered by a `VerificationReply`."""
        return self._key("registration", "command", "verify")

    @property
    def robot_state(self) -> str:
        """`RobotState`; last value kept."""
        return self._key("robot", "state")

    def robot_command(self, verb: Verb) -> str:
        """Query with a command, answered by a `CommandReply`."""
        return self._key("robot", "command", verb)

    @property
    def case_context(self) -> str:
        """`CaseContext` of the open case; last value kept."""
        return self._key("ui_api", "case")

    @property
    def bus_refusals(self) -> str:
        """`BusRefusals`: what the router has refused since its start; repeated, so none is kept."""
        return self._key("router", "refusals")

    def heartbeat(self, service: ServiceName) -> str:
        """`Heartbeat` of a service."""
        return self._key(service, "heartbeat")

    def status(self, service: ServiceName) -> str:
        """`ServiceStatus` of a service; last value kept."""
        return self._key(service, "status")

    def alive(self, service: ServiceName) -> str:
        """Liveliness token of a service."""
        return self._key("alive", service)

    def alive_as(self, service: ServiceName, identity: str) -> str:
        """Liveliness token of one process of a service that may be only once in a room; `*` for any process."""
        return self._key("alive", service, identity)

"""What the robot service is started with (`DISTALOCK_ROBOT_...`, or the table `[robot]` of the configuration file)."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from services.robot.core.deviation import Deviation
from services.robot.core.guard_context import GuardLimits
from services.robot.core.tuning import CONTROLLER_LINE, SUPERVISION
from services.robot.devices.controller import Encoders
from services.robot.devices.dialects import Dialect
from shared.bus.tls import AUTHORITY_FILE, PKI_FOLDER
from shared.parts.hexapod_file import DEFAULT_HEXAPOD
from shared.pki.permit_key import PERMIT_CERTIFICATE_FILE, PermitVerifier
from shared.robot_states import StopButton
from shared.runtime.settings import ServiceSettings

PositiveSeconds = Annotated[float, Field(gt=0.0, le=3600.0)]


class RobotSettings(ServiceSettings):
    """Settings of the robot service."""

    section: ClassVar[str] = "robot"

    controller_url: str = Field(
        "socket://127.0.0.1:50000", description="Device name or pyserial URL of the hexapod's controller."
    )
    dialect: Dialect = Field(Dialect.GCS, description="Protocol of the controller.")
    controller_baud: Annotated[int, Field(ge=1200, le=4_000_000)] = Field(
        115_200, description="Bits per second of a serial line."
    )
    guardian_socket: Path | None = Field(
        None,
        description="Socket of a guardian host (`guardian_host.py`) that outlives this service's container; default: "
        "the guardian is a process of this service.",
    )
    reply_timeout_s: Annotated[float, Field(gt=0.0, le=2.0)] = Field(
        CONTROLLER_LINE.reply_timeout_s, description="How long the controller may take to answer a question."
    )
    retry_s: PositiveSeconds = Field(1.0, description="Time between attempts to reach the controller.")
    permit_certificate: Path | None = Field(
        None,
        description="Certificate of the key that signs permits; default: in the folder pki of the state folder.",
    )
    hexapod_file: Path = Field(DEFAULT_HEXAPOD, description="The robot's geometry, `distalock/hexapod/1`.")
    encoders: Encoders = Field(
        Encoders.ABSOLUTE, description="Incremental ones move for reference: only with the guide off the bone."
    )
    stop_button: Literal["fitted", "absent"] = Field(
        "fitted", description="Whether the controller has a stop button of its own; one that reports is believed."
    )
    largest_step_mm: Annotated[float, Field(gt=0.0, le=40.0)] = Field(20.0, description="Longest way of one move.")
    largest_step_deg: Annotated[float, Field(gt=0.0, le=30.0)] = Field(12.0, description="Largest turn of one move.")
    plan_lifetime_s: PositiveSeconds = Field(600.0, description="Age from which a plan is refused.")
    heartbeat_deadline_s: Annotated[float, Field(gt=0.0, le=0.5)] = Field(
        0.2, description="Silence of the gateway in motion after which the robot stops."
    )
    registration_deadline_s: Annotated[float, Field(gt=0.0, le=5.0)] = Field(
        1.0, description="Longest silence of registration before a move; it speaks five times a second."
    )

    def permit_verifier(self) -> PermitVerifier:
        """Knows the gateway's signature on permits to move; raises `ConfigurationError`."""
        own = self.state_dir / PKI_FOLDER / self.section
        return PermitVerifier.from_files(
            self.permit_certificate or own / PERMIT_CERTIFICATE_FILE,
            self.tls_authority or own / AUTHORITY_FILE,
            datetime.now(UTC),
        )

    def guard_limits(self) -> GuardLimits:
        """Limits of a single move."""
        return GuardLimits(
            Deviation(self.largest_step_mm, self.largest_step_deg),
            self.plan_lifetime_s,
            self.heartbeat_deadline_s,
            self.registration_deadline_s,
        )

    def initial_stop_button(self) -> StopButton:
        """What is known of the controller's stop button before anybody has acknowledged anything."""
        return StopButton.RELEASED if self.stop_button == "fitted" else StopButton.ABSENT

    def reference_travel(self) -> Deviation:
        """How far the robot may move for reference."""
        return SUPERVISION.read_back if self.encoders is Encoders.ABSOLUTE else SUPERVISION.reference_travel

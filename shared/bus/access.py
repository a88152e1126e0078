"""Who may do what on which key: one table, from which the router's rules, the page and the tests are made.

A key has one exchange and, apart from what every service has of its own, one provider. Whatever is not in the table is
denied.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final, get_args

from shared.bus.keys import Keys
from shared.messages.presence import ServiceName
from shared.robot_states import Verb

SERVICES: Final[tuple[ServiceName, ...]] = get_args(ServiceName)
# Shows the room to the hospital's control desk (`shared.bus.exporter`): it receives some keys and sends nothing.
EXPORTER: Final = "exporter"
# Who has a certificate of the room. The router has a name in the table and no certificate of a service: what it says
# itself passes no rules.
CLIENTS: Final[tuple[str, ...]] = (*SERVICES, EXPORTER)
_SHOWN: Final = frozenset((EXPORTER,))


class Exchange(StrEnum):
    """How a key is used, and with that what its provider and its consumers may do."""

    STREAM = "stream"
    RETAINED = "retained"
    QUERY = "query"
    TOKEN = "liveliness token"  # noqa: S105 - not a secret


@dataclass(frozen=True, slots=True)
class Row:
    """One key expression.

    Attributes
    ----------
    provider
        Who publishes, answers or holds the token.
    consumers
        Who may receive, ask or watch.
    carries
        Messages and manners, for the page.
    subscribed_as
        Key expression that consumers name, where they take several rows at once; the key itself otherwise.
    """

    key: str
    exchange: Exchange
    provider: str
    consumers: frozenset[str]
    carries: str
    subscribed_as: str = ""


def access_table(keys: Keys) -> tuple[Row, ...]:
    """The table of one operating room."""
    return (
        *_imaging(keys),
        *_registration(keys),
        *_robot(keys),
        *_ui_api(keys),
        *_router(keys),
        *_of_every_service(keys),
    )


def _imaging(keys: Keys) -> tuple[Row, ...]:
    stream, retained, query = Exchange.STREAM, Exchange.RETAINED, Exchange.QUERY
    viewers, gateway = _services("registration", "ui_api"), _services("ui_api")
    pixels = "raw float32 pixels, `FrameHeader` as attachment; newest wins, shared memory"
    same = "the same, by the image's hash, so that no single shot is lost"
    calibration = "`CalibrationMessage`: accepted with values, or rejected with reasons"
    missed = "`StoredImagesRequest` -> `StoredImagesReply`: headers after a number, and what became of each image"
    report = "`QaRequest` -> `QaReply`: a quality report over kept images, with its page"
    return (
        Row(keys.frame, stream, "imaging", viewers, pixels),
        Row(keys.any_frame_by_hash, query, "imaging", viewers, same),
        Row(keys.calibration, retained, "imaging", viewers, calibration),
        Row(keys.any_calibration_of, query, "imaging", gateway, "the same, by the image's number in the store"),
        Row(keys.stored_images, query, "imaging", gateway, missed),
        Row(keys.qa_request, query, "imaging", gateway, report),
    )


def _registration(keys: Keys) -> tuple[Row, ...]:
    stream, retained, query = Exchange.STREAM, Exchange.RETAINED, Exchange.QUERY
    gateway, robot = _services("ui_api"), _services("robot")
    record = (
        "`LocalisationRecord`, for every image of an open case; of running fluoroscopy for its newest when that is due"
    )
    guidance = "`Guidance`: tilts and advice from a frame of running fluoroscopy, or why there is none; its age counts"
    epoch = (
        "`RegistrationEpoch`: the newest state of registration, confirmed; at every change and at 5 Hz; its age counts"
    )
    again = "`LocalisationRequest` -> `LocalisationReply`: an image's localisation, or why there is none"
    verification = "`VerificationRequest` -> `VerificationReply`"
    return (
        Row(keys.localisation, retained, "registration", gateway, record),
        Row(keys.guidance, stream, "registration", gateway, guidance),
        Row(keys.registration_epoch, stream, "registration", robot, epoch),
        Row(keys.plan, retained, "registration", robot, "`Plan`; the robot knows plans only from here"),
        Row(keys.localisation_request, query, "registration", gateway, again),
        Row(keys.plan_request, query, "registration", gateway, "`PlanRequest` -> `PlanReply`"),
        Row(keys.verification_request, query, "registration", gateway, verification),
    )


def _robot(keys: Keys) -> tuple[Row, ...]:
    gateway = _services("ui_api")
    state = "`RobotState`, on change and at a steady rate"
    commands = tuple(
        Row(keys.robot_command(verb), Exchange.QUERY, "robot", gateway, _command(verb)) for verb in get_args(Verb)
    )
    process = "one process of the robot service; a room has place for one (`shared/runtime/sole_service.py`)"
    return (
        Row(keys.robot_state, Exchange.RETAINED, "robot", _services("registration", "ui_api") | _SHOWN, state),
        *commands,
        Row(keys.alive_as("robot", "*"), Exchange.TOKEN, "robot", _services("robot"), process),
    )


def _command(verb: Verb) -> str:
    match verb:
        case "stop":
            return "`StopCommand` -> `CommandReply`; never stale, never a repeat"
        case "move":
            return "`MoveCommand` (a plan's hash and a permit) -> `CommandReply`; at most once, never late"
        case "reference":
            return "`PlainCommand` with a permit -> `CommandReply`; at most once, never late"
        case _:
            return "`PlainCommand` -> `CommandReply`; at most once, never late"


def _ui_api(keys: Keys) -> tuple[Row, ...]:
    others = _services("imaging", "registration", "robot")
    case = "`CaseContext`: the open case with its part files, and what is in the guide or the bone"
    return (Row(keys.case_context, Exchange.RETAINED, "ui_api", others | _SHOWN, case),)


def _router(keys: Keys) -> tuple[Row, ...]:
    refusals = "`BusRefusals`: what it has refused since its start, at every change and every 5 s"
    return (Row(keys.bus_refusals, Exchange.STREAM, "router", _services("ui_api") | _SHOWN, refusals),)


def _of_every_service(keys: Keys) -> tuple[Row, ...]:
    gateway = _services("ui_api")
    watchers: dict[ServiceName, frozenset[str]] = {
        "ui_api": _services("ui_api", "robot"),
        "registration": _services("ui_api", "robot"),
        "imaging": _services("ui_api", "robot"),
    }
    heard: dict[ServiceName, frozenset[str]] = {
        "ui_api": _services("robot"),
        "registration": _services("ui_api", "robot"),
        "imaging": _services("ui_api", "robot"),
    }
    beat = "`Heartbeat`, robot at 5 Hz, others at 20 Hz; while the robot moves, silence of any of them stops it"
    heartbeats = (Row(keys.heartbeat(s), Exchange.STREAM, s, heard.get(s, gateway), beat) for s in SERVICES)
    statuses = (Row(keys.status(s), Exchange.RETAINED, s, gateway | _SHOWN, "`ServiceStatus`") for s in SERVICES)
    tokens = (
        Row(keys.alive(s), Exchange.TOKEN, s, watchers.get(s, gateway) | _SHOWN, "the service is connected")
        for s in SERVICES
    )
    return (*heartbeats, *statuses, *tokens)


def _services(*names: ServiceName) -> frozenset[str]:
    return frozenset(names)

"""Command-line arguments: argparse, but bad usage is one line on stderr and exit code 2."""

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NoReturn
from urllib.parse import urlsplit

from distalock.outputs import require_writable
from shared.arguments import EXIT_BAD_INPUT as EXIT_BAD_INPUT
from shared.arguments import OneLineParser as OneLineParser
from shared.equipment import USUAL_DRILL_DIAMETER_MM
from shared.errors import InputError
from shared.parts.catalogue import FOLDER

# What a shell reports of a program that SIGPIPE ended.
EXIT_UNREAD: Final = 141

PART_HELP: Final = "{} file (JSON), or the name of one in the catalogue"

# The usual port of each listener of an installation, and what it is for.
PORTS: Final[Mapping[str, tuple[int, str]]] = {
    "router": (7447, "the bus router"),
    "rest": (8000, "the REST gateway"),
    "dicom": (11112, "receiving DICOM images"),
    "gcs": (50000, "the virtual hexapod controller"),
    "control": (8900, "the virtual room's control API"),
}

Run = Callable[[argparse.Namespace], int]
Declares = Callable[[argparse.ArgumentParser], None]


@dataclass(frozen=True, slots=True)
class Command:
    """One subcommand.

    Attributes
    ----------
    summary
        First line of its help.
    add_arguments
        Declares its arguments.
    run
        Does it; returns the exit code. Heavy imports belong inside.
    """

    name: str
    summary: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Run


def parser_of(commands: tuple[Command, ...], arguments: Sequence[str]) -> OneLineParser:
    """Parser of `distalock` with its subcommands; only one named in `arguments` declares its own, to start quickly."""
    parser = OneLineParser(
        prog="distalock",
        description="Aims a drill guide at the distal holes of an intramedullary nail. "
        "Research software, not a medical device.",
    )
    parser.add_argument("--version", action=_PrintVersion, nargs=0, help="print version and revision")
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in commands:
        sub = subparsers.add_parser(command.name, help=command.summary, description=command.summary)
        if command.name in arguments:
            command.add_arguments(sub)
        sub.set_defaults(run=command.run, command=command.name)
    return parser


class _PrintVersion(argparse.Action):
    """Prints version and revision, which are looked up only when they are asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print them and end."""
        from distalock.version import version_line

        print(version_line())
        parser.exit()


def named_path(text: str) -> Path:
    """Parse the name of a file or folder; an empty word, as an unset variable of a shell leaves, is none."""
    if not text.strip() or "\0" in text:
        raise argparse.ArgumentTypeError(f"{text!r} names no file; give the name of one")
    try:
        Path(text).exists()
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{text[:60]!r} cannot be looked at: {error.strerror or error}") from None
    return Path(text)


def part_file(text: str) -> Path:
    """Parse a part: the name of a file, or of a part of the catalogue where there is no such file."""
    path = named_path(text)
    shipped = FOLDER / f"{text}.json"
    return shipped if not path.exists() and path.name == text and shipped.is_file() else path


def existing_file(text: str) -> Path:
    """Parse the name of a file that must be there."""
    path = named_path(text)
    if path.is_dir():
        raise argparse.ArgumentTypeError(f"{text} is a folder; name a file in it")
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"file {text} does not exist")
    return path.resolve()


def writable_file(text: str) -> Path:
    """Parse the name of a file to write; a place where none can be written is refused before any work is done."""
    path = named_path(text)
    try:
        require_writable(path)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return path


def whole_number(what: str, least: int, most: int) -> Callable[[str], int]:
    """Parser of a number in a range, which a refusal calls `what`, as in "a port number"."""

    def parse(text: str) -> int:
        digits = text.isascii() and text.isdecimal() and len(text) <= len(str(most))
        if not digits or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text!r} is not {what} from {least} to {most}")
        return int(text)

    return parse


port_number: Final = whole_number("a port number", 1, 65535)


def add_port_arguments(parser: argparse.ArgumentParser, names: Iterable[str]) -> None:
    """Declare ``--NAME-port`` for some of `PORTS`."""
    for name in names:
        default, used_for = PORTS[name]
        parser.add_argument(
            f"--{name}-port", type=port_number, default=default, metavar="PORT", help=f"port of {used_for} ({default})"
        )


def add_actions(
    parser: argparse.ArgumentParser, actions: Mapping[str, tuple[str, Declares]], common: Iterable[Declares]
) -> None:
    """Declare subcommands: each with its summary and its own arguments, then those that all have."""
    parsers = parser.add_subparsers(required=True, metavar="ACTION")
    for name, (summary, declare) in actions.items():
        action = parsers.add_parser(name, help=summary, description=summary)
        action.set_defaults(action=name)
        for each in (declare, *common):
            each(action)


def add_record_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare where the case record is."""
    parser.add_argument("--state", type=named_path, default=Path("state"), help="state folder of the installation")
    parser.add_argument(
        "--database", metavar="URL", help="the record's database; default: as set, then SQLite in the state folder"
    )


seed_number: Final = whole_number("a seed", 0, 2**63 - 1)


def controller_url(text: str) -> str:
    """Parse the device or pyserial URL of a hexapod controller; it need not be there yet."""
    import serial

    try:
        serial.serial_for_url(text.strip() or "nothing://", do_not_open=True)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no address of a controller: {error}; give one such as /dev/ttyUSB0 or socket://192.168.1.5:50000"
        ) from None
    return text.strip()


def server_url(text: str) -> str:
    """Parse the address of an HTTP server; it need not be there yet."""
    address = urlsplit(text.strip())
    try:
        whole = address.scheme in ("http", "https") and address.hostname is not None and address.port != 0
    except ValueError:
        whole = False
    if not whole:
        raise argparse.ArgumentTypeError(f"{text!r} is no address of a server; give one such as https://gateway:8000")
    return text.strip()


def length_mm(least: float, most: float) -> Callable[[str], float]:
    """Parser of a length in a range, in mm."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{text!r} is not a length in mm from {least:g} to {most:g}")
        return value

    return parse


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Every option of the virtual operating room that an installation does not decide itself."""
    from simulation.settings import OF_THE_INSTALLATION, add_room_arguments

    add_room_arguments(parser, leave_out=OF_THE_INSTALLATION)


def scenario_arguments(given: argparse.Namespace) -> tuple[str, ...]:
    """The same choice, as arguments of the virtual operating room's process."""
    from simulation.settings import OF_THE_INSTALLATION, room_arguments

    return room_arguments(given, leave_out=OF_THE_INSTALLATION)


def add_image_arguments(parser: argparse.ArgumentParser) -> None:
    """What `locate`, `verify` and `align` share: the part files and the C-arm's nominal values."""
    for name in ("ring", "guide", "nail"):
        parser.add_argument(f"--{name}", type=part_file, required=True, metavar="PART", help=PART_HELP.format(name))
    add_c_arm_arguments(parser)


def add_drill_argument(parser: argparse.ArgumentParser) -> None:
    """The drill that is to pass the nail's holes."""
    parser.add_argument(
        "--drill-mm",
        type=length_mm(1.0, 10.0),
        default=USUAL_DRILL_DIAMETER_MM,
        metavar="MM",
        help=f"diameter of the drill, for the chance to pass a hole ({USUAL_DRILL_DIAMETER_MM:g})",
    )


def add_c_arm_arguments(parser: argparse.ArgumentParser) -> None:
    """The C-arm's nominal values."""
    parser.add_argument(
        "--source-to-detector-mm",
        type=length_mm(500.0, 2000.0),
        metavar="MM",
        help="nominal; default: DICOM header, then 1000",
    )
    parser.add_argument(
        "--pixel-mm",
        type=length_mm(0.05, 2.0),
        metavar="MM",
        help="nominal, at the detector; default: DICOM header, then 0.235",
    )
    parser.add_argument(
        "--focal-spot-mm",
        type=length_mm(0.05, 3.0),
        metavar="MM",
        help="edge of the focal spot; default: DICOM header, then 0.5",
    )
    parser.add_argument(
        "--invert",
        action="store_true",
        help="metal is bright in these images, although the files state the opposite or nothing",
    )

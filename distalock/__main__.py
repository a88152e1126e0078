"""The `distalock` command: arguments in, exit code out. The work is done by the modules beside this one."""

import argparse
import gc
import importlib
import os
import sys
from pathlib import Path

from distalock.arguments import (
    EXIT_BAD_INPUT,
    EXIT_UNREAD,
    PART_HELP,
    PORTS,
    Command,
    Run,
    add_c_arm_arguments,
    add_drill_argument,
    add_image_arguments,
    add_port_arguments,
    add_scenario_arguments,
    controller_url,
    existing_file,
    length_mm,
    named_path,
    parser_of,
    part_file,
    scenario_arguments,
    writable_file,
)
from distalock.bench import is_benchmark, print_list, run_benchmarks
from distalock.inputs import require_inputs
from shared.equipment import USUAL_WIRE_DIAMETER_MM
from shared.errors import ConfigurationError, InputError


def _locate_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "images",
        type=named_path,
        nargs="+",
        metavar="image",
        help="PNG or TIFF of 8 or 16 bits, or DICOM; several are taken as one set-up and joined, unless --each",
    )
    add_image_arguments(parser)
    add_drill_argument(parser)
    parser.add_argument("--method", choices=["model", "fronto-parallel"], default="model", help="ours, or the paper's")
    more = parser.add_mutually_exclusive_group()
    more.add_argument("--overlay", type=writable_file, metavar="OUT.png", help="draw what was found")
    more.add_argument(
        "--each", action="store_true", help="localise each image, or each of a folder, by itself: one JSON line each"
    )


def _imported(module: str) -> Run:
    """Import a module when its command is run, and call its `run`."""

    def run(given: argparse.Namespace) -> int:
        gc.disable()  # imports make objects that stay: a tenth of their time would go into examining these
        try:
            command = importlib.import_module(module)
        finally:
            gc.enable()
        return int(command.run(given))

    return run


def _verify_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "images",
        type=named_path,
        nargs="+",
        metavar="IMAGE",
        help="one, or two from different directions: PNG or TIFF of 8 or 16 bits, or DICOM",
    )
    parser.add_argument(
        "--before",
        type=named_path,
        nargs="+",
        default=[],
        metavar="IMAGE",
        help="from before the wires, with the guide in the same place: wires cover the holes",
    )
    parser.add_argument(
        "--wire-mm",
        type=length_mm(0.5, 6.0),
        default=USUAL_WIRE_DIAMETER_MM,
        metavar="MM",
        help=f"diameter of the wires, 0.5 to 6 mm (default {USUAL_WIRE_DIAMETER_MM:g})",
    )
    parser.add_argument("--guide-alone", action="store_true", help="there are no wires: verify the guide's own holes")
    add_image_arguments(parser)
    add_drill_argument(parser)


def _mounting_site_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("image", type=named_path, metavar="IMAGE", help="lateral, of the nail's end: PNG, TIFF, DICOM")
    for kind, default in (("ring", None), ("nail", None), ("guide", "guide-28"), ("hexapod", "hexapod-h70")):
        wanted = {"required": True} if default is None else {"default": default}
        parser.add_argument(f"--{kind}", type=part_file, metavar="PART", help=PART_HELP.format(kind), **wanted)
    add_c_arm_arguments(parser)
    parser.add_argument("--overlay", type=named_path, metavar="PNG", help="write the image with the screws' axes drawn")


def _align_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "images", type=named_path, nargs="+", metavar="IMAGE", help="frames in order: images, folders of them, videos"
    )
    add_image_arguments(parser)


def _up_arguments(parser: argparse.ArgumentParser) -> None:
    hardware = parser.add_mutually_exclusive_group(required=True)
    hardware.add_argument("--simulate", action="store_true", help="run the virtual operating room too")
    hardware.add_argument(
        "--controller", type=controller_url, metavar="URL", help="device or pyserial URL of the real hexapod controller"
    )
    parser.add_argument(
        "--state", type=named_path, default=Path("state"), help="folder for images, case record, keys and logs"
    )
    parser.add_argument(
        "--plain-bus",
        action="store_true",
        help="no certificates: whoever reaches the router's port may speak as any service",
    )
    parser.add_argument(
        "--https", action="store_true", help="the gateway speaks HTTPS; needed where it is reached from elsewhere"
    )
    parser.add_argument(
        "--site", metavar="ENDPOINT", help="show this room at the hospital's site router, such as tls/site.example:7448"
    )
    parser.add_argument(
        "--site-keys", type=named_path, metavar="FOLDER", help="this room's folder that `distalock site init` has made"
    )
    parser.add_argument(
        "--print-token",
        action="store_true",
        help="with --simulate: the token of the user demo on stdout; where the installation runs already, nothing else",
    )
    add_scenario_arguments(parser)
    add_port_arguments(parser, PORTS)


def _up(given: argparse.Namespace) -> int:
    from rich.console import Console

    from distalock.installation import Installation, Ports, SiteLink
    from distalock.up import print_token, run_installation

    if given.controller is not None and scenario_arguments(given):
        return _refused_up("--seed and --scenario belong to --simulate; leave them away with --controller")
    numbers = [getattr(given, f"{name}_port") for name in PORTS]
    if len(set(numbers)) < len(numbers):
        return _refused_up(
            f"ports {', '.join(map(str, numbers))} are not {len(numbers)} different ones; give each its own"
        )
    if (given.site is None) is not (given.site_keys is None):
        return _refused_up("--site and --site-keys belong together: the site's router, and this room's keys for it")
    ports = Ports(given.router_port, given.rest_port, given.dicom_port, given.gcs_port, given.control_port)
    installation = Installation(
        ports,
        given.state.resolve(),
        given.controller,
        scenario_arguments(given),
        given.plain_bus,
        given.https,
        None if given.site is None else SiteLink(given.site, given.site_keys.resolve()),
    )
    if not given.print_token:
        return run_installation(installation, Console(soft_wrap=True))
    if not given.simulate:
        return _refused_up("--print-token belongs to --simulate; with a real controller people sign in")
    try:
        runs_already = print_token(installation)
    except ConfigurationError as error:
        return _refused_up(str(error))
    return 0 if runs_already else run_installation(installation, Console(soft_wrap=True, stderr=True))


def _refused_up(why: str) -> int:
    print(f"distalock up: {why}", file=sys.stderr)
    return EXIT_BAD_INPUT


def _demo_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument(
        "--overlay", type=writable_file, metavar="OUT.png", help="write what was found in the last image"
    )
    parser.add_argument(
        "--console",
        action="store_true",
        help="do nothing by itself: print the console's address, open a case, and run until Ctrl-C, so that you do the "
        "procedure in a browser",
    )


def _demo(given: argparse.Namespace) -> int:
    from rich.console import Console

    from distalock.demo import DemoRequest, run_demo, show_console

    if given.console:
        if given.overlay is not None:
            print(
                "distalock demo: --overlay is of the procedure that runs by itself; leave it away with --console",
                file=sys.stderr,
            )
            return EXIT_BAD_INPUT
        return show_console(scenario_arguments(given), Console(soft_wrap=True))
    return run_demo(DemoRequest(scenario_arguments(given), given.overlay), Console(soft_wrap=True))


def _procedure_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.procedure_arguments import add_arguments

    add_arguments(parser)


def _room_arguments(parser: argparse.ArgumentParser) -> None:
    from simulation.settings import add_room_arguments

    add_room_arguments(parser)


def _robot_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.robot import add_arguments

    add_arguments(parser)


def _robot(given: argparse.Namespace) -> int:
    return int(given.run_robot(given))


def _qa_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=named_path, help="folder of images of the ring: PNG, TIFF or DICOM")
    parser.add_argument("--ring", type=part_file, required=True, metavar="PART", help=PART_HELP.format("ring"))
    parser.add_argument(
        "--out", type=named_path, metavar="FOLDER", help="where the report goes; default: qa in the folder"
    )
    parser.add_argument(
        "--before", type=existing_file, metavar="QA.json", help="report to compare with; default: the last one there"
    )
    add_c_arm_arguments(parser)


def _calibrate_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.calibrate import add_arguments

    add_arguments(parser)


def _operations_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.operations_arguments import add_arguments

    add_arguments(parser)


def _parts_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.parts_arguments import add_arguments

    add_arguments(parser)


def _pki_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.pki_arguments import add_arguments

    add_arguments(parser)


def _users_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.users_arguments import add_arguments

    add_arguments(parser)


def _record_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.record.arguments import add_arguments

    add_arguments(parser)


def _doctor_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.doctor.arguments import add_arguments

    add_arguments(parser)


def _site_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.site.arguments import add_arguments

    add_arguments(parser)


def _risk_arguments(parser: argparse.ArgumentParser) -> None:
    from distalock.risk import add_arguments

    add_arguments(parser)


def _benchmark_name(text: str) -> str:
    if not is_benchmark(text):
        raise argparse.ArgumentTypeError(f"there is no benchmark {text!r}; `distalock bench` lists them")
    return text


def _bench_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", type=_benchmark_name, metavar="NAME", help="`all`, or one of the list")
    parser.add_argument("more", nargs=argparse.REMAINDER, help="more names, or arguments of the one benchmark named")


def _bench(given: argparse.Namespace) -> int:
    return run_benchmarks([given.name, *given.more]) if given.name else print_list()


COMMANDS = (
    Command(
        "locate",
        "the nail's hole axes from one X-ray image or several, or why not",
        _locate_arguments,
        _imported("distalock.locate"),
    ),
    Command(
        "verify",
        "K-wires against the nail's hole axes, from one image or a pair",
        _verify_arguments,
        _imported("distalock.verify"),
    ),
    Command(
        "mounting-site",
        "where the screws of the robot's mount go, from a lateral image of the nail",
        _mounting_site_arguments,
        _imported("distalock.mounting_site"),
    ),
    Command(
        "align",
        "how to turn the C-arm, from frames of running fluoroscopy",
        _align_arguments,
        _imported("distalock.align"),
    ),
    Command("up", "run router and all services on this machine until Ctrl-C", _up_arguments, _up),
    Command("demo", "the whole procedure in the virtual operating room, with its true errors", _demo_arguments, _demo),
    Command(
        "procedure",
        "a case on an installation that runs already, with a virtual operating room's hands",
        _procedure_arguments,
        _imported("distalock.running_procedure"),
    ),
    Command("virtual-or", "the virtual operating room alone", _room_arguments, _imported("simulation.__main__")),
    Command("robot", "the robot's workspace, and the calibration of its guide", _robot_arguments, _robot),
    Command(
        "qa",
        "C-arm and ring over a folder of images: a page with pictures, and JSON",
        _qa_arguments,
        _imported("distalock.qa"),
    ),
    Command(
        "calibrate",
        "where the balls of a built ring or guide are, from several images of it",
        _calibrate_arguments,
        _imported("distalock.part_calibration.command"),
    ),
    Command(
        "pki",
        "keys and certificates of an installation: make, show, renew, make all anew",
        _pki_arguments,
        _imported("distalock.pki"),
    ),
    Command(
        "operations",
        "what a running gateway does that takes time: how far it is, and an end to what is computed",
        _operations_arguments,
        _imported("distalock.operations"),
    ),
    Command(
        "parts",
        "which part files an installation may use: approve, list",
        _parts_arguments,
        _imported("distalock.parts"),
    ),
    Command(
        "record",
        "the case record: verify, back up, restore, hand over, prune",
        _record_arguments,
        _imported("distalock.record.command"),
    ),
    Command(
        "users",
        "accounts of an installation: list, make, change, disable",
        _users_arguments,
        _imported("distalock.users"),
    ),
    Command(
        "doctor",
        "what of this machine and installation would keep a procedure from going well, with remedies",
        _doctor_arguments,
        _imported("distalock.doctor.command"),
    ),
    Command(
        "site",
        "many rooms: their keys, the router that they show themselves to, and a desk that sees all",
        _site_arguments,
        _imported("distalock.site.command"),
    ),
    Command(
        "risk",
        "the risk file against the tests that ran",
        _risk_arguments,
        _imported("distalock.risk"),
    ),
    Command(
        "bench",
        "the benchmarks: without a name the list, otherwise tables with ratios to the named peers",
        _bench_arguments,
        _bench,
    ),
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command; bad usage is one line on stderr and exit code 2."""
    words = sys.argv[1:] if arguments is None else arguments
    given = parser_of(COMMANDS, words).parse_args(words)
    try:
        require_inputs(given)
        code = int(given.run(given))
        sys.stdout.flush()
    except InputError as error:
        print(f"distalock {given.command}: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except BrokenPipeError:
        # Whoever read the output has left, as `head` does; the interpreter must not find that out again when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_UNREAD
    return code


if __name__ == "__main__":
    sys.exit(main())

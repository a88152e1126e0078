"""`distalock demo`: an installation with the virtual operating room, and the whole procedure through REST."""

import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from distalock.arguments import EXIT_BAD_INPUT
from distalock.case_client import CaseClient
from distalock.client import Client, RequestRefused
from distalock.installation import Installation, Ports
from distalock.outputs import write_whole
from distalock.procedure import Ending, Outcome, Procedure, Tell
from distalock.processes import Fleet
from distalock.rest_client import RestClient
from distalock.room_client import RoomClient, Scenario, TrueError
from services.ui_api.core.access_settings import DEMO_USER
from shared.errors import ConfigurationError, InputError
from shared.runtime.settings import ANNOUNCE_VARIABLE
from shared.signals import set_by_signals

EXIT_CODES: Final = {Ending.DRILLED: 0, Ending.MISSED: 1, Ending.REFUSED: 3}


@dataclass(frozen=True, slots=True)
class DemoRequest:
    """What to demonstrate.

    Attributes
    ----------
    scenario_arguments
        ``("--seed", "3")`` or ``("--scenario", FILE)``.
    overlay
        Where to write the last image with what was found drawn on it, or None.
    """

    scenario_arguments: tuple[str, ...]
    overlay: Path | None = None


def run_demo(request: DemoRequest, console: Console) -> int:
    """Run the demonstration and print its table.

    Returns
    -------
    int
        0 when all drills passed, 1 when one did not, 2 when the installation did not start, 3 when the system refused.
    """
    try:
        outcome = demonstrate(request, progress(console))
    except (ConfigurationError, InputError, TimeoutError) as error:
        print(f"distalock demo: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except RequestRefused as error:
        print(f"distalock demo: refused: {error}", file=sys.stderr)
        return EXIT_CODES[Ending.REFUSED]
    console.print(outcome_table(outcome))
    console.print(conclusion(outcome), highlight=False)
    return EXIT_CODES[outcome.ending]


def show_console(scenario_arguments: tuple[str, ...], console: Console) -> int:
    """Start everything on free ports with an open case, print the console's address, and run until Ctrl-C.

    Returns
    -------
    int
        0 after Ctrl-C, 1 when a process ended by itself, 2 when the installation did not start.
    """
    stop = threading.Event()
    try:
        with set_by_signals(stop), _installed(scenario_arguments, stop) as (installation, fleet):
            scenario = _opened_case(installation)
            for line in console_lines(installation, scenario.description):
                console.print(line, highlight=False)
            ended = fleet.wait_until_one_ends()
    except (ConfigurationError, InputError, TimeoutError) as error:
        print(f"distalock demo: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except RequestRefused as error:
        print(f"distalock demo: refused: {error}", file=sys.stderr)
        return EXIT_CODES[Ending.REFUSED]
    if ended is not None:
        print(f"distalock demo: {ended} ended by itself", file=sys.stderr)
    return int(ended is not None)


def console_lines(installation: Installation, description: str) -> list[str]:
    """What somebody needs who wants to do the procedure in a browser."""
    return [
        f"console     {installation.gateway.url}/",
        f"sign in as  {DEMO_USER}, with the password {installation.token}",
        f"case        {description}; its panel [bold]Virtual room[/bold] is pedal, C-arm, wires and drill",
        "Ctrl-C stops everything.",
    ]


def demonstrate(request: DemoRequest, tell: Tell) -> Outcome:
    """Start everything on free ports, do the procedure, stop everything.

    Raises
    ------
    ConfigurationError
        When a process does not start.
    TimeoutError
        When the installation falls silent.
    """
    with _installed(request.scenario_arguments, threading.Event()) as (installation, _):
        tell(f"SIMULATION: services are up, REST at {installation.gateway.url}")
        return _procedure_in(installation, request, tell)


@contextmanager
def _installed(scenario_arguments: tuple[str, ...], stop: threading.Event) -> Iterator[tuple[Installation, Fleet]]:
    """An installation with the virtual room, on free ports, in a folder that goes afterwards."""
    with tempfile.TemporaryDirectory(prefix="distalock-demo-") as folder:
        os.environ.setdefault(ANNOUNCE_VARIABLE, "0")  # one case in a folder that goes afterwards fills no disk
        installation = Installation(Ports.any_free(), Path(folder), scenario_arguments=scenario_arguments)
        with installation.fleet(stop) as fleet:
            installation.write_directory(fleet.pids)
            yield installation, fleet


def _opened_case(installation: Installation) -> Scenario:
    """Open the virtual room's case."""
    with (
        Client(installation.gateway.url, installation.token) as gateway,
        RestClient(installation.ports.control_url) as control,
    ):
        scenario = RoomClient(control).scenario()
        CaseClient.opened(gateway, scenario.set_up)
        return scenario


def _procedure_in(installation: Installation, request: DemoRequest, tell: Tell) -> Outcome:
    with (
        Client(installation.gateway.url, installation.token) as gateway,
        RestClient(installation.ports.control_url) as control,
    ):
        room = RoomClient(control)
        scenario = room.scenario()
        case = CaseClient.opened(gateway, scenario.set_up)
        tell(f"case opened: {scenario.description}")
        outcome = Procedure(case, room, scenario.hole_ids, tell).run()
        if request.overlay is not None and outcome.shots:
            write_whole(request.overlay, case.overlay_png(case.newest_image_id()))
            tell(f"what was found in the last image: {request.overlay}")
        return outcome


def progress(console: Console) -> Tell:
    """Prints lines, each with the time since now."""
    begun = time.monotonic()

    def tell(line: str) -> None:
        console.print(f"[dim]{time.monotonic() - begun:6.1f} s[/dim]  {line}", highlight=False)

    return tell


def outcome_table(outcome: Outcome) -> Table:
    """True errors of each guide hole's axis before and after, and where the drills went."""
    table = Table(title="true errors of the guide's axes: at the nail hole's entry and exit, and their angle")
    table.add_column("hole", no_wrap=True)
    for name in ("before", "after", "drill"):
        table.add_column(name, justify="right", no_wrap=True)
    drills = {d.hole_id: d for d in outcome.drills}
    for before, after in zip(outcome.before, outcome.after, strict=True):
        drill = drills.get(before.hole_id)
        fate = "not drilled" if drill is None else "passed" if drill.passed else f"struck {drill.struck}"
        table.add_row(before.hole_id, _figures(before), _figures(after), fate)
    table.caption = f"{outcome.shots} X-ray shots, {outcome.moves} moves"
    return table


def _figures(error: TrueError) -> str:
    return f"{error.entry_offset_mm:.2f} mm  {error.exit_offset_mm:.2f} mm  {error.angle_deg:.2f}°"


def conclusion(outcome: Outcome) -> str:
    """One sentence on how it ended."""
    match outcome.ending:
        case Ending.DRILLED:
            return f"{len(outcome.drills)} of {len(outcome.before)} drills passed their holes."
        case Ending.MISSED:
            missed = ", ".join(d.hole_id for d in outcome.drills if not d.passed)
            return f"A drill did not pass: {missed}."
        case Ending.REFUSED:
            return f"Refused: {outcome.why}"

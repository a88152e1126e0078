"""`distalock up`: everything on this machine until Ctrl-C."""

import sys
import threading
from typing import Final

from rich.console import Console

from distalock.arguments import EXIT_BAD_INPUT
from distalock.installation import Installation
from distalock.processes import Fleet, taken_folder
from distalock.readiness import why_not_ready
from services.ui_api.core.access_settings import DEMO_USER, SETUP_FILE
from shared.bus.access import EXPORTER
from shared.bus.tls import PLAIN_BUS_WARNING
from shared.errors import ConfigurationError
from shared.hosts import PLAIN_HTTP_WARNING, is_loopback
from shared.signals import set_by_signals

EXIT_OK, EXIT_FAULT = 0, 1
MOST_ROBOT_RESTARTS: Final = 5
MOST_EXPORTER_RESTARTS: Final = 5


def run_installation(installation: Installation, console: Console) -> int:
    """Start all processes, say where they are, and stop them all on Ctrl-C or when one of them ends.

    Returns
    -------
    int
        Exit code: 0 after Ctrl-C or SIGTERM, 1 when a process ended by itself, 2 when something could not start.
    """
    stop = threading.Event()
    try:
        installation.require_free_ports()
        with set_by_signals(stop), installation.fleet(stop) as fleet:
            installation.write_directory(fleet.pids)
            _announce(installation, console)
            ended = _watch(fleet, console)
            last_words = fleet.last_words(ended) if ended else ""
            console.print("stopping; the robot locks first" if ended is None else "one process ended; stopping all")
    except ConfigurationError as error:
        print(f"distalock up: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    if ended is not None:
        print(f"distalock up: {ended} ended by itself: {last_words}", file=sys.stderr)
        return EXIT_FAULT
    return EXIT_OK


def set_up_link(installation: Installation) -> str | None:
    """The one-time link for the first account; None when there is an account."""
    file = installation.state_dir / SETUP_FILE
    return f"{installation.gateway.url}{file.read_text(encoding='ascii').strip()}" if file.exists() else None


def print_token(installation: Installation) -> bool:
    """Print the simulation's token for programs; whether the installation runs already."""
    print(installation.token, flush=True)
    try:
        taken_folder(installation.state_dir / "logs").close()
    except ConfigurationError:
        return True
    return False


def _watch(fleet: Fleet, console: Console) -> str | None:
    """Wait for the end; the name of the process that ended by itself, None after Ctrl-C.

    The robot service is started again at once, for it stops and locks a hexapod that it finds moving; nothing else can.
    The exporter is given up when it does not stay: the room works without the hospital.
    """
    restarts_left = {"robot": MOST_ROBOT_RESTARTS, EXPORTER: MOST_EXPORTER_RESTARTS}
    while (ended := fleet.wait_until_one_ends()) in restarts_left:
        assert ended is not None
        if restarts_left[ended] > 0:
            restarts_left[ended] -= 1
            console.print(f"the {ended} ended by itself ({fleet.last_words(ended)}); starting it again")
            fleet.restart(ended)
        elif ended == EXPORTER:
            console.print(f"this room is no longer shown at the site: {fleet.last_words(ended)}")
            fleet.forget(ended)
        else:
            break
    return ended


def _announce(installation: Installation, console: Console) -> None:
    ports, gateway = installation.ports, installation.gateway
    everywhere = "" if installation.rest_host in gateway.url else f" (listens on {installation.rest_host})"
    console.print(f"console           {gateway.url}/{everywhere}", highlight=False)
    console.print(f"REST              {gateway.url}/openapi.json", highlight=False)
    if installation.https:
        console.print(f"HTTPS, for browsers: trust {gateway.authority}", highlight=False)
    elif not is_loopback(installation.rest_host):
        console.print(f"[bold]WARNING[/bold]           {PLAIN_HTTP_WARNING}", highlight=False)
    console.print(f"DICOM C-STORE     {installation.dicom_address}", highlight=False)
    if installation.simulated:
        console.print(
            f"[bold]SIMULATION[/bold]        user {DEMO_USER}: surgeon and administrator; password and token "
            f"{installation.token}",
            highlight=False,
        )
        console.print(f"SIMULATION        virtual operating room, control at {ports.control_url}", highlight=False)
    elif (link := set_up_link(installation)) is not None:
        console.print(f"[bold]FIRST START[/bold]       make the first account, once: {link}", highlight=False)
    if installation.takes_unapproved_parts:
        console.print("part files        taken without approval, because this is a simulation", highlight=False)
    if installation.site is not None:
        console.print(f"site              shown at {installation.site.endpoint}", highlight=False)
    if installation.plain_bus:
        console.print(f"[bold]WARNING[/bold]           {PLAIN_BUS_WARNING}", highlight=False)
    console.print(f"state and logs    {installation.state_dir}", highlight=False)
    if lacking := why_not_ready(gateway):
        console.print(f"not ready yet     {lacking}", highlight=False)
    console.print("Ctrl-C stops everything and leaves the robot locked.", highlight=False)

"""`distalock up`: everything on this machine until Ctrl-C."""

import signal
import sys
import threading

from rich.console import Console

from distalock.installation import Installation
from shared.errors import ConfigurationError

EXIT_OK, EXIT_FAULT, EXIT_BAD_INPUT = 0, 1, 2


def run_installation(installation: Installation, console: Console) -> int:
    """Start all processes, say where they are, and stop them all on Ctrl-C or when one of them ends.

    Returns
    -------
    int
        Exit code: 0 after Ctrl-C or SIGTERM, 1 when a process ended by itself, 2 when something could not start.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        installation.require_free_ports()
        with installation.fleet(stop) as fleet:
            installation.write_directory(fleet.pids)
            _announce(installation, console)
            ended = fleet.wait_until_one_ends()
            last_words = fleet.last_words(ended) if ended else ""
            console.print("stopping; the robot locks first" if ended is None else "one process ended; stopping all")
    except ConfigurationError as error:
        print(f"distalock up: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    if ended is not None:
        print(f"distalock up: {ended} ended by itself: {last_words}", file=sys.stderr)
        return EXIT_FAULT
    return EXIT_OK


def _announce(installation: Installation, console: Console) -> None:
    ports = installation.ports
    console.print(f"console and REST  {ports.rest_url}", highlight=False)
    console.print(f"API document      {ports.rest_url}/openapi.json", highlight=False)
    console.print(f"DICOM C-STORE     127.0.0.1:{ports.dicom}", highlight=False)
    if installation.simulated:
        console.print(f"SIMULATION        virtual operating room, control at {ports.control_url}", highlight=False)
    console.print(f"state and logs    {installation.state_dir}", highlight=False)
    console.print("Ctrl-C stops everything and leaves the robot locked.", highlight=False)

"""`distalock procedure`: one case on an installation that runs already, whatever state its robot is in.

Asks the gateway over REST for everything; the hands are those of a virtual operating room.
"""

import argparse
import sys
import time
from typing import Final

import httpx
from rich.console import Console

from distalock.arguments import EXIT_BAD_INPUT
from distalock.case_client import CaseClient
from distalock.client import Client
from distalock.demo import EXIT_CODES, conclusion, outcome_table, progress
from distalock.procedure import Outcome, Procedure, Tell
from distalock.readiness import GatewayReady, Server, why_not_ready
from distalock.rest_client import RestClient
from distalock.room_client import RoomClient
from shared.errors import ConfigurationError, DistalockError
from shared.pki.private_files import read_file

_POLL_S: Final = 0.2
# As long as the virtual room and a localisation may take on a busy machine.
_ANSWER_S: Final = 300.0
_CONNECT_S: Final = 30.0


def run(given: argparse.Namespace) -> int:
    """Exit code: 0 when all drills passed, 1 when one did not, 2 when nobody is there, 3 when the system refused."""
    console = Console(soft_wrap=True)
    server = Server(given.rest.rstrip("/"), given.authority)
    try:
        token = read_file(given.token_file).decode("ascii").strip()
        wait_until_usable(server, given.wait_s)
        outcome = procedure_at(server, token, given.room, progress(console))
    except (DistalockError, TimeoutError, httpx.HTTPError) as error:
        print(f"distalock procedure: {error or type(error).__name__}", file=sys.stderr)
        return EXIT_BAD_INPUT
    console.print(outcome_table(outcome))
    console.print(conclusion(outcome), highlight=False)
    return EXIT_CODES[outcome.ending]


def wait_until_usable(server: Server, patience_s: float) -> None:
    """Until all services are there; raises `ConfigurationError` with what is missing.

    A robot in fault, as one whose controller was lost, is no reason not to begin: it is reset.
    """
    usable, deadline_s = GatewayReady(server), time.monotonic() + patience_s
    while not usable():
        if time.monotonic() > deadline_s:
            why = why_not_ready(server)
            raise ConfigurationError(f"{server.url} is not ready after {patience_s:g} s: {why}; see `readyz` there")
        time.sleep(_POLL_S)


def procedure_at(server: Server, token: str, room_url: str, tell: Tell) -> Outcome:
    """Lead a case. One that is open, as after a client that was lost, is abandoned first: the room plays one patient.

    Raises
    ------
    RequestRefused
        When no case can be opened.
    TimeoutError
        When the installation falls silent.
    """
    with (
        connection_to(server) as http,
        Client(server.url, token, http=http) as gateway,
        RestClient(room_url) as control,
    ):
        room = RoomClient(control)
        scenario = room.scenario()
        for forgotten in CaseClient.open_cases(gateway):
            tell(f"case {forgotten.id} was open still; it is abandoned")
            room.remove_wires()
            forgotten.abandon("another procedure begins")
        case = CaseClient.opened(gateway, scenario.set_up)
        tell(f"case opened: {scenario.description}")
        outcome = Procedure(case, room, scenario.hole_ids, tell).run()
        case.abandon("the procedure ends here")
        return outcome


def connection_to(server: Server) -> httpx.Client:
    """A connection that trusts the authority of an installation, or those of the system."""
    return httpx.Client(timeout=httpx.Timeout(_ANSWER_S, connect=_CONNECT_S), verify=server.trusted())

"""`distalock operations`: what a gateway does that takes time: how far it is, and an end to what is computed."""

import argparse
import sys
import time
from typing import Final

import httpx

from distalock.arguments import EXIT_BAD_INPUT
from distalock.client import Client, RequestRefused
from distalock.client.models import OperationView
from distalock.readiness import Server
from distalock.robot_readiness import ENDED
from distalock.running_procedure import connection_to
from shared.errors import DistalockError
from shared.pki.private_files import read_file

EXIT_NOT_DONE: Final = 1
EXIT_REFUSED: Final = 3
_POLL_S: Final = 0.2


def run(given: argparse.Namespace) -> int:
    """Exit code: 0 when done, 1 when what was followed had no success, 2 when nobody is there, 3 when refused."""
    server = Server(given.rest.rstrip("/"), given.authority)
    try:
        token = read_file(given.token_file).decode("ascii").strip()
        with connection_to(server) as http, Client(server.url, token, http=http) as gateway:
            return _done(gateway, given)
    except RequestRefused as refusal:
        print(f"distalock operations: {refusal}", file=sys.stderr)
        return EXIT_REFUSED
    except (DistalockError, httpx.HTTPError) as error:
        print(f"distalock operations: {error or type(error).__name__}", file=sys.stderr)
        return EXIT_BAD_INPUT


def _done(gateway: Client, given: argparse.Namespace) -> int:
    match given.action:
        case "list":
            for operation in gateway.iterate_operations(status=given.status):
                print(line_of(operation))
        case "follow":
            return _followed(gateway, given.operation)
        case "cancel":
            print(line_of(gateway.cancel_operation(given.operation)))
    return 0


def _followed(gateway: Client, operation_id: str) -> int:
    said = ""
    while True:
        operation = gateway.read_operation(operation_id)
        line = line_of(operation)
        if line != said:
            print(line, flush=True)
            said = line
        if operation.status in ENDED:
            return 0 if operation.status == "succeeded" else EXIT_NOT_DONE
        time.sleep(_POLL_S)


def line_of(operation: OperationView) -> str:
    """An operation in one line: how far it is, or what came of it."""
    progress = operation.progress
    share = "" if progress.fraction is None else f", {progress.fraction:.0%}"
    how_far = f"step {progress.step} of {progress.steps}: {progress.says}{share}"
    ended = operation.status in ENDED
    why = (
        operation.detail if operation.code == operation.status else f"{operation.code}: {operation.detail}".strip(": ")
    )
    outcome = operation.result or why
    return f"{operation.id}  {operation.verb}  {operation.status}  {outcome if ended else how_far}".rstrip()

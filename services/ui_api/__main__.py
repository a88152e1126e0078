"""Run the gateway: `python -m services.ui_api`; or `verify` the case record, or print the OpenAPI file (`openapi`)."""

import argparse
import json
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import uvicorn

from services.ui_api.app import make_app, openapi_document, routed_app
from services.ui_api.core.chain import ChainBroken
from services.ui_api.desks.clock import Clock
from services.ui_api.record.database import open_database
from services.ui_api.record.verify import verify_record
from services.ui_api.service import open_gateway
from services.ui_api.settings import UiApiSettings
from shared.bus.port import Bus
from shared.errors import ConfigurationError
from shared.runtime.lifecycle import Runtime, run_service
from shared.runtime.settings import load_settings

_LEAVE_WITHIN_S = 3


def main(arguments: list[str]) -> int:
    """Exit code: 0 fine, 1 a fault or a broken record, 2 cannot start (one line on stderr says why)."""
    given = _parser().parse_args(arguments)
    if given.command == "openapi":
        print(json.dumps(openapi_document(routed_app()), indent=1, ensure_ascii=False))
        return 0
    try:
        settings = load_settings(UiApiSettings, host=given.host, port=given.port, state_dir=given.state_dir)
        return _verify(settings) if given.command == "verify" else _serve(settings)
    except ConfigurationError as error:
        print(f"ui_api: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m services.ui_api", description=__doc__)
    parser.add_argument("command", nargs="?", choices=("serve", "verify", "openapi"), default="serve")
    parser.add_argument("--host", help="address to listen on")
    parser.add_argument("--port", type=int, help="port to listen on; 0: any free")
    parser.add_argument("--state-dir", help="folder for the case record and the images")
    return parser


def _verify(settings: UiApiSettings) -> int:
    verdict = verify_record(open_database(settings.record_url()))
    if isinstance(verdict, ChainBroken):
        print(f"broken: {verdict.message}")
        return 1
    print(f"intact: {verdict.entries} events, head {verdict.head_sha256}")
    return 0


def _serve(settings: UiApiSettings) -> int:
    with bound_socket(settings.host, settings.port) as listening:

        @contextmanager
        def compose(bus: Bus, runtime: Runtime) -> Iterator[None]:
            with open_gateway(bus, runtime, settings, Clock()) as gateway:
                server = uvicorn.Server(
                    uvicorn.Config(
                        make_app(gateway),
                        log_config=None,
                        access_log=False,
                        timeout_graceful_shutdown=_LEAVE_WITHIN_S,
                    )
                )
                with _serving(server, listening, runtime):
                    runtime.log.info("listening", address=listening.getsockname())
                    yield
                    gateway.feed.close()

        return run_service("ui_api", settings, compose)


@contextmanager
def _serving(server: uvicorn.Server, listening: socket.socket, runtime: Runtime) -> Iterator[None]:
    """The HTTP server on a thread of its own: signals are the business of the main thread."""

    def serve() -> None:
        server.run(sockets=[listening])
        if not runtime.stop.is_set():
            runtime.fail("the HTTP server ended by itself")

    thread = threading.Thread(target=serve, name="http", daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.should_exit = True
        thread.join(_LEAVE_WITHIN_S + 2.0)


def bound_socket(host: str, port: int) -> socket.socket:
    """A listening socket.

    Raises
    ------
    ConfigurationError
        When the port is in use or the address is not this machine's.
    """
    listening = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
    except OSError as error:
        listening.close()
        raise ConfigurationError(
            f"the REST interface cannot listen on {host} port {port}: {error.strerror or error}; end the program that "
            "holds it or choose another with DISTALOCK_UI_API_PORT"
        ) from None
    return listening


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

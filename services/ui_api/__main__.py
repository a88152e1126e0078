"""Run the gateway: `python -m services.ui_api`; or print the OpenAPI file (`openapi`)."""

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from services.ui_api.app import make_app, openapi_document, routed_app
from services.ui_api.handlers.clock import Clock
from services.ui_api.server import listening_socket, serving
from services.ui_api.service import open_gateway
from services.ui_api.settings import UiApiSettings
from shared.arguments import OneLineParser
from shared.bus.port import Bus
from shared.errors import ConfigurationError
from shared.hosts import PLAIN_HTTP_WARNING, is_loopback
from shared.runtime.help import settings_help
from shared.runtime.lifecycle import Runtime, run_service
from shared.runtime.settings import load_settings
from shared.runtime.tls_context import Clients, server_context


def main(arguments: list[str]) -> int:
    """Exit code: 0 fine, 1 a fault, 2 cannot start (one line on stderr says why)."""
    given = _parser().parse_args(arguments)
    if given.command == "openapi":
        print(json.dumps(openapi_document(routed_app()), indent=1, ensure_ascii=False))
        return 0
    try:
        settings = load_settings(UiApiSettings, host=given.host, port=given.port, state_dir=given.state_dir)
        return _serve(settings)
    except ConfigurationError as error:
        print(f"ui_api: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m services.ui_api",
        description=__doc__,
        epilog=settings_help(UiApiSettings),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", nargs="?", choices=("serve", "openapi"), default="serve")
    parser.add_argument("--host", help="address to listen on")
    parser.add_argument("--port", type=int, help="port to listen on; 0: any free")
    parser.add_argument("--state-dir", help="folder for the case record and the images")
    return parser


def _serve(settings: UiApiSettings) -> int:
    files = settings.https_files()
    https = None if files is None else server_context(files, Clients.ANYBODY)
    listening = listening_socket(settings.host, settings.port)

    @contextmanager
    def compose(bus: Bus, runtime: Runtime) -> Iterator[None]:
        def early_end() -> None:
            runtime.fail("the HTTP server ended by itself")

        with (
            open_gateway(bus, runtime, settings, Clock()) as gateway,
            serving(make_app(gateway, settings.allowed_hosts), listening, early_end, https),
        ):
            runtime.log.info("listening", address=listening.getsockname(), https=https is not None)
            if https is None and not is_loopback(settings.host):
                runtime.log.warning("plain_http", detail=PLAIN_HTTP_WARNING)
            yield
            gateway.feed.close()  # event streams end now, or the server would wait for them

    with listening:
        return run_service("ui_api", settings, compose)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

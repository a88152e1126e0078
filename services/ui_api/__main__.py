"""Run the gateway: `python -m services.ui_api`; or print the OpenAPI file (`openapi`)."""

import argparse
import sys
from importlib import import_module
from types import ModuleType

from services.ui_api.front.gateway import run_gateway
from services.ui_api.front.port import listening_socket
from services.ui_api.settings import UiApiSettings
from shared.arguments import OneLineParser
from shared.errors import ConfigurationError
from shared.memory import share_arenas
from shared.runtime.help import settings_help
from shared.runtime.settings import load_settings
from shared.runtime.tls_context import Clients, server_context
from shared.scheduling import keep_collections_short, take_precedence


def main(arguments: list[str]) -> int:
    """Exit code: 0 fine, 1 a fault, 2 cannot start (one line on stderr says why)."""
    given = _parser().parse_args(arguments)
    if given.command == "openapi":
        return int(_offline().print_openapi())
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


def _offline() -> ModuleType:
    """Loaded when wanted: the front stays as small as what it does."""
    return import_module("services.ui_api.offline")


def _serve(settings: UiApiSettings) -> int:
    files = settings.https_files()
    https = None if files is None else server_context(files, Clients.ANYBODY)
    with listening_socket(settings.host, settings.port) as listening:
        return run_gateway(settings, listening, https)


if __name__ == "__main__":
    take_precedence()
    keep_collections_short()
    share_arenas()
    sys.exit(main(sys.argv[1:]))

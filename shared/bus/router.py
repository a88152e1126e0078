"""The router as a Python process: `python -m shared.bus.router [--config FILE] [--listen tcp/127.0.0.1:7447]`.

A session opened with ``mode: router`` is a full Zenoh router, with no Python in the data path. The same JSON5 file
serves an official `zenohd`.
"""

import json
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import zenoh

from shared.arguments import OneLineParser
from shared.errors import ConfigurationError
from shared.signals import set_by_signals

# The services end first; the robot's locks the hexapod and says so.
LINGER_S: Final = 5.0
DEFAULT_CONFIG = Path(__file__).with_name("router.json5")


@contextmanager
def running_router(config_file: Path = DEFAULT_CONFIG, listen: Sequence[str] = ()) -> Iterator[None]:
    """A router for as long as the context lasts.

    Parameters
    ----------
    config_file
        Zenoh configuration in JSON5.
    listen
        Endpoints that replace those of the file, when given.

    Raises
    ------
    ConfigurationError
        When the file cannot be read or used, or when an endpoint is in use.
    """
    config = router_config(config_file, listen)
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise ConfigurationError(_why_not_open(json.loads(config.get_json("listen/endpoints")), error)) from error
    with session:
        yield


def router_config(config_file: Path, listen: Sequence[str]) -> zenoh.Config:
    """Read a router's configuration; raises `ConfigurationError`."""
    try:
        config = zenoh.Config.from_file(config_file)
        if listen:
            config.insert_json5("listen/endpoints", json.dumps(list(listen)))
    except zenoh.ZError as error:
        raise ConfigurationError(f"router configuration {config_file} cannot be used: {_first_line(error)}") from error
    return config


def _why_not_open(endpoints: Sequence[str], error: zenoh.ZError) -> str:
    where = ", ".join(endpoints)
    if "Address already in use" in str(error):
        return f"{where} is in use by another program; stop it or listen elsewhere (--listen tcp/127.0.0.1:PORT)"
    return f"the router cannot listen at {where}: {_first_line(error)}"


def _first_line(error: zenoh.ZError) -> str:
    return " ".join(str(error).split()).split(" at /")[0]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGTERM or SIGINT; 0 after a clean end, 2 when the router cannot start."""
    parser = OneLineParser(prog="python -m shared.bus.router", description="The message router.")
    parser.add_argument("--config", type=Path, default=DEFAULT_CONFIG, help="Zenoh configuration, JSON5")
    parser.add_argument("--listen", action="append", default=[], help="endpoint, e.g. tcp/127.0.0.1:7447; repeatable")
    given = parser.parse_args(arguments)
    stop = threading.Event()
    try:
        with set_by_signals(stop, LINGER_S), running_router(given.config, given.listen):
            stop.wait()
    except ConfigurationError as error:
        print(f"router: {error}", file=sys.stderr)  # noqa: T201 - the one sentence for the person at the terminal
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""A service that does nothing but be there: ``python -m tests.contract.runtime.example_service``."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from shared.bus.port import Bus
from shared.runtime.lifecycle import Runtime, service_main
from shared.runtime.settings import ServiceSettings


@contextmanager
def compose(_settings: ServiceSettings, _bus: Bus, runtime: Runtime) -> Iterator[None]:
    """Be ready; say so when leaving was clean."""
    runtime.log.info("composed")
    yield
    runtime.log.info("left cleanly")


if __name__ == "__main__":
    sys.exit(service_main("robot", ServiceSettings, compose))

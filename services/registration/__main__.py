"""Start registration: `python -m services.registration`."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from services.registration.service import RegistrationService
from services.registration.settings import RegistrationSettings
from services.registration.state import RegistrationState
from shared.bus.port import Bus
from shared.compiled import load_kernels
from shared.runtime.lifecycle import Runtime, service_main


@contextmanager
def compose(settings: RegistrationSettings, bus: Bus, runtime: Runtime) -> Iterator[None]:
    """Build the service and run it for as long as the context lasts."""
    runtime.log.info("kernels", detail=load_kernels().sentence)  # before the service is ready: no first image waits
    state = RegistrationState(runtime.boot_epoch, settings.kept_images, settings.image_delay_s, time.monotonic)
    with RegistrationService(bus, runtime, settings, state).running():
        yield


if __name__ == "__main__":
    sys.exit(service_main("registration", RegistrationSettings, compose))

"""Start imaging: `python -m services.imaging`. The only place that builds its adapters."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from services.imaging.devices.dicom_receiver import Endpoint, dicom_receiver
from services.imaging.devices.image_store import ImageStore
from services.imaging.service import Defaults, ImagingService
from services.imaging.settings import ImagingSettings
from shared.bus.port import Bus
from shared.runtime.lifecycle import Runtime, service_main


@contextmanager
def compose(settings: ImagingSettings, bus: Bus, runtime: Runtime) -> Iterator[None]:
    """Build the service and run it for as long as the context lasts."""
    store = ImageStore(settings.state_dir / "images")
    defaults = Defaults(settings.default_source_to_detector_mm, settings.default_pixel_mm)
    service = ImagingService(bus, runtime, store, defaults)
    endpoint = Endpoint(settings.dicom_host, settings.dicom_port, settings.dicom_ae_title)
    with service.running(), dicom_receiver(endpoint, service.take, runtime.log) as port:
        runtime.log.info("receiving images", port=port, ae_title=endpoint.ae_title)
        yield


if __name__ == "__main__":
    sys.exit(service_main("imaging", ImagingSettings, compose))

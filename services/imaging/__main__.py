"""Start imaging: `python -m services.imaging`. The only place that builds its adapters."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime

from services.imaging.devices.c_arm_memory import CArmMemory
from services.imaging.devices.dicom_receiver import DicomSource, Endpoint
from services.imaging.devices.folder_source import FolderSource
from services.imaging.devices.image_store import ImageStore
from services.imaging.devices.position_store import PositionStore
from services.imaging.devices.received_image import Polarity
from services.imaging.devices.source import ImageSource
from services.imaging.devices.video_images import Region
from services.imaging.devices.video_source import VideoSettings, VideoSource
from services.imaging.service import Calibrator, Defaults, ImagingService
from services.imaging.service.quality_handler import QualityHandler
from services.imaging.settings import ImagingSettings
from shared.bus.port import Bus
from shared.compiled import load_kernels
from shared.runtime.clock import Clock
from shared.runtime.lifecycle import Runtime, service_main
from shared.runtime.logging import Log
from shared.runtime.tls_context import Clients, server_context

# The gateway's last announcement arrives within milliseconds; without a gateway nobody has a case open.
_CASE_WITHIN_S = 1.0


@contextmanager
def compose(settings: ImagingSettings, bus: Bus, runtime: Runtime) -> Iterator[None]:
    """Build the service and run it for as long as the context lasts."""
    runtime.log.info("kernels", detail=load_kernels().sentence)  # before the service is ready: no first image waits
    store = ImageStore(settings.state_dir / "images")
    defaults = Defaults(
        settings.default_source_to_detector_mm,
        settings.default_pixel_mm,
        Polarity.INVERTED if settings.images_inverted else Polarity.AS_TAGGED,
    )
    memory = CArmMemory(PositionStore(settings.state_dir / "c-arm-positions"))
    quality = QualityHandler(store, settings.state_dir / "qa", lambda: datetime.now(UTC))
    calibrator = Calibrator(bus, runtime, store, memory)
    service = ImagingService(bus, runtime, store, calibrator, quality, defaults, settings.run_interval_s, Clock())
    with service.running(), ExitStack() as stack:
        service.wait_for_case(_CASE_WITHIN_S)
        places = [stack.enter_context(s.receiving(service.take)) for s in sources(settings, runtime.log)]
        for place in places:
            runtime.log.info("receiving images", source=place)
        runtime.ready("; ".join(places))
        yield


def sources(settings: ImagingSettings, log: Log) -> list[ImageSource]:
    """Where images come from, by the settings: always DICOM, a folder and a video if they are set."""
    endpoint = Endpoint(
        settings.dicom_host,
        settings.dicom_port,
        settings.dicom_ae_title,
        settings.dicom_calling_ae_titles,
        settings.dicom_most_associations,
        server_context(settings.dicom_tls_files(), Clients.WITH_CERTIFICATE) if settings.dicom_tls else None,
        settings.dicom_tls_senders,
    )
    found: list[ImageSource] = [DicomSource(endpoint, log)]
    if settings.watched_folder is not None:
        found.append(FolderSource(settings.watched_folder, log))
    if settings.video:
        region = Region(*settings.video_region) if settings.video_region else None
        frames = settings.video_frames
        found.append(VideoSource(VideoSettings(settings.video, region, min(3, frames), frames), log))
    return found


if __name__ == "__main__":
    sys.exit(service_main("imaging", ImagingSettings, compose))

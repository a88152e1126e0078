"""Receive images from a C-arm: a DICOM Storage provider with verification (C-ECHO)."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from pydicom.dataset import Dataset
from pydicom.uid import (
    UID,
    ComputedRadiographyImageStorage,
    DigitalXRayImageStorageForPresentation,
    DigitalXRayImageStorageForProcessing,
    MultiFrameGrayscaleByteSecondaryCaptureImageStorage,
    MultiFrameGrayscaleWordSecondaryCaptureImageStorage,
    SecondaryCaptureImageStorage,
    XRayAngiographicImageStorage,
    XRayRadiofluoroscopicImageStorage,
)
from pynetdicom import AE, evt

from shared.errors import ConfigurationError, ImageUnreadable
from shared.runtime.logging import Log

_STORED = (
    XRayAngiographicImageStorage,
    XRayRadiofluoroscopicImageStorage,
    DigitalXRayImageStorageForPresentation,
    DigitalXRayImageStorageForProcessing,
    ComputedRadiographyImageStorage,
    SecondaryCaptureImageStorage,
    MultiFrameGrayscaleByteSecondaryCaptureImageStorage,
    MultiFrameGrayscaleWordSecondaryCaptureImageStorage,
)
_VERIFICATION = UID("1.2.840.10008.1.1")
_SUCCESS = 0x0000
_OUT_OF_RESOURCES = 0xA700
_CANNOT_UNDERSTAND = 0xC000
_COMMENT_LENGTH = 64


class Refused(Exception):
    """Raised by whoever takes images when it cannot take one now."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where the receiver listens, and under which application entity title."""

    host: str
    port: int
    ae_title: str


class _StoreEvent(Protocol):
    """What is used of pynetdicom's event."""

    @property
    def assoc(self) -> "_Association": ...

    def encoded_dataset(self) -> bytes: ...


class _Association(Protocol):
    @property
    def requestor(self) -> "_Requestor": ...


class _Requestor(Protocol):
    @property
    def ae_title(self) -> str: ...

    @property
    def address(self) -> str: ...

    @property
    def primitive(self) -> "_Request | None": ...


class _Request(Protocol):
    @property
    def called_ae_title(self) -> str: ...


@contextmanager
def dicom_receiver(endpoint: Endpoint, take: Callable[[bytes, str], None], log: Log) -> Iterator[int]:
    """Listen for images for as long as the context lasts.

    Parameters
    ----------
    endpoint
        Where to listen; port 0 picks a free one.
    take
        Called with each object as a DICOM file and its sender's name, from the receiver's threads. When it returns, the
        image is acknowledged. `ImageUnreadable` refuses the object for good, `Refused` and `OSError` for now.
    log
        Gets one line for each refusal.

    Yields
    ------
    int
        The port.

    Raises
    ------
    ConfigurationError
        When the port is in use.
    """
    entity = AE(ae_title=endpoint.ae_title)
    entity.require_called_aet = True
    entity.maximum_pdu_size = 0
    for uid in (_VERIFICATION, *_STORED):
        entity.add_supported_context(uid)
    handlers: list[evt.EventHandlerType] = [
        (evt.EVT_C_STORE, lambda event: _stored(event, take, log)),
        (evt.EVT_REJECTED, lambda event: _log_rejection(event, endpoint, log)),
    ]
    try:
        server = entity.start_server((endpoint.host, endpoint.port), block=False, evt_handlers=handlers)
    except OSError as error:
        raise ConfigurationError(
            f"port {endpoint.port} for DICOM reception cannot be used ({error.strerror or error}); "
            "end the program that holds it or set another dicom_port"
        ) from None
    assert server is not None, "a server that does not block is returned"
    try:
        yield int(server.server_address[1])
    finally:
        server.shutdown()
        server.server_close()


def _stored(event: _StoreEvent, take: Callable[[bytes, str], None], log: Log) -> Dataset:
    requestor = event.assoc.requestor
    sender = f"{requestor.ae_title.strip()}@{requestor.address}"
    try:
        take(event.encoded_dataset(), sender)
    except ImageUnreadable as error:
        log.warning("image refused", sender=sender, detail=str(error))
        return _status(_CANNOT_UNDERSTAND, str(error))
    except (Refused, OSError) as error:
        log.error("image not taken", sender=sender, detail=str(error))  # noqa: TRY400 - expected: no trace
        return _status(_OUT_OF_RESOURCES, str(error))
    return _status(_SUCCESS, "")


def _status(code: int, comment: str) -> Dataset:
    status = Dataset()
    status.Status = code
    if comment:
        status.ErrorComment = comment.encode("ascii", "replace").decode()[:_COMMENT_LENGTH]
    return status


def _log_rejection(event: _StoreEvent, endpoint: Endpoint, log: Log) -> None:
    requestor = event.assoc.requestor
    called = requestor.primitive.called_ae_title.strip() if requestor.primitive else "nobody"
    log.warning(
        "association rejected",
        sender=f"{requestor.ae_title.strip()}@{requestor.address}",
        detail=f"it called {called}, it must call the application entity title {endpoint.ae_title}",
    )

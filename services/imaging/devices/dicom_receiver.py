"""Receive images from a C-arm: a DICOM Storage provider with verification (C-ECHO)."""

import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from pydicom.dataset import Dataset
from pydicom.pixels.decoders.base import get_decoder
from pydicom.uid import (
    HTJ2K,
    JPEG2000,
    UID,
    ComputedRadiographyImageStorage,
    DeflatedExplicitVRLittleEndian,
    DigitalXRayImageStorageForPresentation,
    DigitalXRayImageStorageForProcessing,
    ExplicitVRBigEndian,
    ExplicitVRLittleEndian,
    HTJ2KLossless,
    HTJ2KLosslessRPCL,
    ImplicitVRLittleEndian,
    JPEG2000Lossless,
    JPEGBaseline8Bit,
    JPEGExtended12Bit,
    JPEGLossless,
    JPEGLosslessSV1,
    JPEGLSLossless,
    JPEGLSNearLossless,
    MultiFrameGrayscaleByteSecondaryCaptureImageStorage,
    MultiFrameGrayscaleWordSecondaryCaptureImageStorage,
    RLELossless,
    SecondaryCaptureImageStorage,
    XRayAngiographicImageStorage,
    XRayRadiofluoroscopicImageStorage,
)
from pynetdicom import AE, evt

from services.imaging.devices.association_gate import REQUEST_WITHIN_S, GatedHandler, GatedServer
from services.imaging.devices.receiver_activity import LEAVE_WITHIN_S, ReceiverActivity
from services.imaging.devices.source import Refused, Take
from shared.errors import ConfigurationError, ImageUnreadable
from shared.runtime.logging import Log
from shared.threads import supervised_thread

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
_COMPRESSED = (
    JPEGLosslessSV1,
    JPEGLossless,
    JPEGLSLossless,
    JPEGLSNearLossless,
    JPEG2000Lossless,
    JPEG2000,
    HTJ2KLossless,
    HTJ2KLosslessRPCL,
    HTJ2K,
    RLELossless,
    JPEGBaseline8Bit,
    JPEGExtended12Bit,
)
_VERIFICATION = UID("1.2.840.10008.1.1")
_SUCCESS = 0x0000
# DICOM PS3.4, table B.2-1: states of C-STORE; PS3.5: a comment (LO) has 64 characters.
_OUT_OF_RESOURCES = 0xA700
_CANNOT_UNDERSTAND = 0xC000
_COMMENT_LENGTH = 64
# Chosen: what a sender's network may take to answer, and short enough to free a place.
_ACSE_TIMEOUT_S = 5.0
# DICOM PS3.8, table 9-21: rejected for now, by the presentation service, local limit exceeded.
_TRANSIENT, _PRESENTATION, _LIMIT_EXCEEDED = 0x02, 0x03, 0x02
# Chosen: a receiver that is asked to leave does so within this time.
_POLL_S = 0.1
# Chosen: a bound on memory, far above the C-arms of a hospital.
_MOST_KNOWN = 256


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where the receiver listens, under which application entity title, and to whom.

    Attributes
    ----------
    calling_ae_titles
        Titles that may call; anyone when empty.
    most_associations
        At the same time.
    tls
        None for DICOM without TLS.
    tls_senders
        Common names of certificates that may connect; whoever has one of the authority when empty.
    """

    host: str
    port: int
    ae_title: str
    calling_ae_titles: tuple[str, ...] = ()
    most_associations: int = 10
    tls: ssl.SSLContext | None = None
    tls_senders: tuple[str, ...] = ()

    @property
    def most_of_unknown_titles(self) -> int:
        """Half of the associations are kept for titles that are listed, or have delivered an image."""
        return self.most_associations - self.most_associations // 2

    @property
    def most_of_one_address(self) -> int:
        """A quarter of the associations is kept for other addresses."""
        return self.most_associations - self.most_associations // 4


class DicomSource:
    """The receiver as a source of images."""

    def __init__(self, endpoint: Endpoint, log: Log) -> None:
        self._endpoint, self._log = endpoint, log

    @contextmanager
    def receiving(self, take: Take) -> Iterator[str]:
        """Listen for as long as the context lasts."""
        with dicom_receiver(self._endpoint, take, self._log) as port:
            under_tls = " under TLS" if self._endpoint.tls else ""
            yield f"DICOM {self._endpoint.ae_title} at {self._endpoint.host}:{port}{under_tls}"


def decodable_syntaxes() -> list[UID]:
    """Transfer syntaxes that can be decoded with what is installed, the uncompressed ones first."""
    plain = [ExplicitVRLittleEndian, ImplicitVRLittleEndian, DeflatedExplicitVRLittleEndian, ExplicitVRBigEndian]
    return plain + [uid for uid in _COMPRESSED if get_decoder(uid).is_available]


class _StoreEvent(Protocol):
    """What is used of pynetdicom's event."""

    @property
    def assoc(self) -> "_Association": ...

    def encoded_dataset(self) -> bytes: ...


class _Acse(Protocol):
    def send_reject(self, result: int, source: int, diagnostic: int) -> None: ...


class _Association(Protocol):
    is_established: bool

    @property
    def requestor(self) -> "_Requestor": ...

    @property
    def acse(self) -> _Acse: ...

    def kill(self) -> None: ...


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

    @property
    def calling_ae_title(self) -> str: ...


@contextmanager
def dicom_receiver(endpoint: Endpoint, take: Take, log: Log) -> Iterator[int]:
    """Listen for images for as long as the context lasts; an image that is on its way then is taken.

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
    entity.require_calling_aet = list(endpoint.calling_ae_titles)
    entity.maximum_associations = endpoint.most_associations
    entity.maximum_pdu_size = 0
    entity.acse_timeout = _ACSE_TIMEOUT_S
    entity.add_supported_context(_VERIFICATION)
    for uid in _STORED:
        entity.add_supported_context(uid, decodable_syntaxes())
    doorkeeper, activity = _Doorkeeper(endpoint, log), ReceiverActivity()

    def store(event: _StoreEvent) -> Dataset:
        with activity.storing():
            return doorkeeper.delivered(event, _stored(event, take, log))

    handlers: list[evt.EventHandlerType] = [
        (evt.EVT_REQUESTED, doorkeeper.requested),
        (evt.EVT_C_STORE, store),
        (evt.EVT_PDU_RECV, activity.note_received),
        (evt.EVT_REJECTED, lambda event: _log_rejection(event, endpoint, log)),
    ]
    try:
        server = entity.make_server(
            (endpoint.host, endpoint.port),
            evt_handlers=handlers,
            server_class=GatedServer,
            request_handler=GatedHandler,
        )
    except OSError as error:
        raise ConfigurationError(
            f"port {endpoint.port} for DICOM reception cannot be used ({error.strerror or error}); "
            "end the program that holds it or set another dicom_port"
        ) from None
    assert isinstance(server, GatedServer)
    server.on_no_request = doorkeeper.log_no_request
    server.on_untrusted = doorkeeper.log_untrusted
    server.tls, server.tls_senders = endpoint.tls, frozenset(endpoint.tls_senders)
    doorkeeper.server = server
    supervised_thread("DICOM reception", lambda: server.serve_forever(_POLL_S)).start()
    try:
        yield int(server.server_address[1])
    finally:
        server.shutdown()  # nobody new; who is within an image ends it
        if not activity.wait_until_quiet():
            log.warning(
                "associations ended", detail=f"they were busy {LEAVE_WITHIN_S:g} s after this service had to end"
            )
        entity.shutdown()


class _Doorkeeper:
    """Keeps places free: for titles that are known, and for other addresses than the one that has most."""

    def __init__(self, endpoint: Endpoint, log: Log) -> None:
        self._endpoint, self._log = endpoint, log
        self._known = set(endpoint.calling_ae_titles)
        self.server: GatedServer | None = None

    def requested(self, event: _StoreEvent) -> None:
        """Reject a request for which no place is left, before anything is negotiated."""
        request = event.assoc.requestor.primitive
        assert self.server is not None
        assert request is not None
        others = [one.requestor for one in self.server.active_associations if one.is_established]
        title, address = request.calling_ae_title.strip(), event.assoc.requestor.address
        unknown = sum(one.ae_title.strip() not in self._known for one in others)
        of_address = sum(one.address == address for one in others)
        if title not in self._known and unknown >= self._endpoint.most_of_unknown_titles:
            why = f"{unknown} associations of titles that have sent no image are open"
        elif of_address >= self._endpoint.most_of_one_address:
            why = f"{of_address} associations of its address are open"
        else:
            return
        most = self._endpoint.most_associations
        why += f" (setting dicom_most_associations {most}; the rest is kept for others); try again later"
        self._log.warning("association rejected", sender=f"{title}@{address}", detail=why)
        event.assoc.acse.send_reject(_TRANSIENT, _PRESENTATION, _LIMIT_EXCEEDED)
        event.assoc.kill()

    def delivered(self, event: _StoreEvent, status: Dataset) -> Dataset:
        """Note who has sent an image that was taken: the next one finds a place."""
        if status.Status == _SUCCESS and len(self._known) < _MOST_KNOWN:
            self._known.add(event.assoc.requestor.ae_title.strip())
        return status

    def log_no_request(self, address: str, count: int) -> None:
        """Connections that ask for nothing are closed; port probes do that."""
        self._log.warning(
            "connection without an association request",
            sender=address,
            detail=f"{count} since the start; each is closed at its end, at the latest after {REQUEST_WITHIN_S:g} s",
        )

    def log_untrusted(self, address: str, why: str) -> None:
        """A connection without the certificate that it needs is closed before it says anything."""
        self._log.warning("association rejected", sender=address, detail=why)


def _stored(event: _StoreEvent, take: Take, log: Log) -> Dataset:
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
    calling = requestor.ae_title.strip()
    if called != endpoint.ae_title:
        why = f"it called {called}, it must call the application entity title {endpoint.ae_title}"
    elif endpoint.calling_ae_titles and calling not in endpoint.calling_ae_titles:
        allowed = ", ".join(endpoint.calling_ae_titles)
        why = f"it calls itself {calling}; the setting dicom_calling_ae_titles allows {allowed}"
    else:
        most = endpoint.most_associations
        why = f"{most} associations are open (limit {most}, setting dicom_most_associations); try again later"
    log.warning("association rejected", sender=f"{calling}@{requestor.address}", detail=why)

"""Send images to the imaging service by DICOM C-STORE, as a C-arm does."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pydicom.uid import ExplicitVRLittleEndian, XRayAngiographicImageStorage
from pynetdicom import AE
from pynetdicom.association import Association

from shared.errors import DeviceError
from simulation.dicom.image import DicomShot
from simulation.dicom.target import DicomTarget

CALLING_TITLE = "VIRTUAL-OR"
_SUCCESS = 0x0000
_WARNINGS = range(0xB000, 0xC000)
_SECONDS = 10.0


class ImageNotDelivered(DeviceError):
    """The image was taken, but nobody took it."""

    code = "image_not_delivered"


def send(shot: DicomShot, target: DicomTarget) -> None:
    """Send one image.

    Raises
    ------
    ImageNotDelivered
        When the target does not answer, or refuses the association or the image; the sentence says which.
    """
    with sending(target) as send_one:
        send_one(shot)


@contextmanager
def sending(target: DicomTarget) -> Iterator[Callable[[DicomShot], None]]:
    """Send images over one association, as a C-arm does with those of a run; raises as `send`."""
    _knock(target)
    entity = AE(ae_title=CALLING_TITLE)
    entity.add_requested_context(XRayAngiographicImageStorage, ExplicitVRLittleEndian)
    entity.connection_timeout = entity.acse_timeout = entity.dimse_timeout = entity.network_timeout = _SECONDS
    association = entity.associate(target.host, target.port, ae_title=target.title)
    if not association.is_established:
        why = "refused the association" if association.is_rejected else "does not answer"
        raise ImageNotDelivered(_undelivered(target, why))
    try:
        yield lambda shot: _store(association, shot, target)
    finally:
        association.release()


def _store(association: Association, shot: DicomShot, target: DicomTarget) -> None:
    if not association.is_established:
        raise ImageNotDelivered(f"DICOM target {target} ended the association before the image; take it again")
    status = association.send_c_store(shot.dataset)
    code = status.get("Status")
    if code is None:
        raise ImageNotDelivered(
            f"DICOM target {target} broke the connection off while it received; take the image again"
        )
    if code != _SUCCESS and code not in _WARNINGS:
        comment = status.get("ErrorComment", "no comment")
        raise ImageNotDelivered(f"DICOM target {target} refused the image with status 0x{code:04X} ({comment})")


def _knock(target: DicomTarget) -> None:
    """Find out whether anybody listens: pynetdicom would leave a socket open that was refused."""
    try:
        socket.create_connection((target.host, target.port), _SECONDS).close()
    except OSError as error:
        raise ImageNotDelivered(_undelivered(target, f"does not answer ({error.strerror or error})")) from None


def _undelivered(target: DicomTarget, why: str) -> str:
    return f"DICOM target {target} {why}; start the imaging service, or correct --dicom-target"

"""The receiver as a C-arm meets it: real associations over the loopback."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import structlog
import structlog.testing
from pydicom.dataset import Dataset
from pydicom.uid import UID, ExplicitVRLittleEndian, SecondaryCaptureImageStorage
from pynetdicom import AE

from services.imaging.devices.dicom_file import read_dicom
from services.imaging.devices.dicom_receiver import Endpoint, dicom_receiver
from services.imaging.devices.source import Refused
from shared.errors import ConfigurationError, ImageUnreadable
from tests.unit.services.imaging.devices.dicom_samples import dataset_of, grey_ramp

LOG: structlog.stdlib.BoundLogger = structlog.stdlib.get_logger("test")
VERIFICATION = UID("1.2.840.10008.1.1")


class Taker:
    """Takes images, or refuses them as told."""

    def __init__(self, refusal: Exception | None = None) -> None:
        self.taken: list[bytes] = []
        self.senders: list[str] = []
        self._refusal = refusal

    def __call__(self, content: bytes, sender: str, _waited_s: float | None = 0.0, /) -> None:
        if self._refusal:
            raise self._refusal
        self.taken.append(content)
        self.senders.append(sender)


@contextmanager
def receiving(taker: Taker) -> Iterator[int]:
    with dicom_receiver(Endpoint("127.0.0.1", 0, "DISTALOCK"), taker, LOG) as port:
        yield port


def sent(port: int, called: str = "DISTALOCK") -> Dataset | None:
    """Status of one C-STORE, or None when the association is refused."""
    entity = AE(ae_title="CARM")
    entity.add_requested_context(SecondaryCaptureImageStorage, ExplicitVRLittleEndian)
    association = entity.associate("127.0.0.1", port, ae_title=called)
    if not association.is_established:
        return None
    status = association.send_c_store(dataset_of(grey_ramp()))
    association.release()
    return status


def test_an_image_arrives_whole() -> None:
    taker = Taker()
    with receiving(taker) as port:
        status = sent(port)
    assert status is not None
    assert status.Status == 0x0000
    assert (read_dicom(taker.taken[0], "taken").pixels == grey_ramp()).all()
    assert taker.senders == ["CARM@127.0.0.1"]


def test_echo_is_answered() -> None:
    entity = AE()
    entity.add_requested_context(VERIFICATION)
    with receiving(Taker()) as port:
        association = entity.associate("127.0.0.1", port, ae_title="DISTALOCK")
        assert association.send_c_echo().Status == 0x0000
        association.release()


@pytest.mark.parametrize(
    ("refusal", "code"),
    [
        (ImageUnreadable("CARM: the DICOM object holds 12 frames"), 0xC000),
        (Refused("64 images wait"), 0xA700),
        (OSError("disk full"), 0xA700),
    ],
)
def test_a_refused_object_gets_a_status_and_the_reason(refusal: Exception, code: int) -> None:
    with receiving(Taker(refusal)) as port:
        status = sent(port)
    assert status is not None
    assert status.Status == code
    assert status.ErrorComment == str(refusal)[:64]


def test_another_title_is_not_associated() -> None:
    taker = Taker()
    with structlog.testing.capture_logs() as lines:
        log: structlog.stdlib.BoundLogger = structlog.stdlib.get_logger("test of rejection")
        with dicom_receiver(Endpoint("127.0.0.1", 0, "DISTALOCK"), taker, log) as port:
            assert sent(port, called="SOMEONE") is None
    assert not taker.taken
    assert lines == [
        {
            "event": "association rejected",
            "log_level": "warning",
            "sender": "CARM@127.0.0.1",
            "detail": "it called SOMEONE, it must call the application entity title DISTALOCK",
        }
    ]


def test_a_port_in_use_is_one_sentence() -> None:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        held.listen()
        port = held.getsockname()[1]
        with (
            pytest.raises(ConfigurationError, match=f"port {port} for DICOM reception cannot be used .* set another"),
            dicom_receiver(Endpoint("127.0.0.1", port, "DISTALOCK"), Taker(), LOG),
        ):
            pass


def test_an_image_that_is_being_stored_is_acknowledged_before_the_receiver_leaves() -> None:
    storing, release, statuses = threading.Event(), threading.Event(), list[Dataset | None]()

    def take(content: bytes, sender: str, _waited_s: float | None = 0.0, /) -> None:
        storing.set()
        assert release.wait(10.0)

    with dicom_receiver(Endpoint("127.0.0.1", 0, "DISTALOCK"), take, LOG) as port:
        sender = threading.Thread(target=lambda: statuses.append(sent(port)))
        sender.start()
        assert storing.wait(10.0)
        threading.Timer(0.2, release.set).start()
    sender.join(10.0)
    assert statuses[0] is not None
    assert statuses[0].Status == 0
    with pytest.raises(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port), 5.0):
        pass


def test_the_port_is_free_again_afterwards() -> None:
    with receiving(Taker()) as port:
        pass
    with dicom_receiver(Endpoint("127.0.0.1", port, "DISTALOCK"), Taker(), LOG) as again:
        assert again == port

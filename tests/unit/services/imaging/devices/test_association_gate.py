"""Connections that ask for nothing keep nobody out, and places are kept for those who send images."""

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest
import structlog
import structlog.testing
from pydicom.uid import ExplicitVRLittleEndian, SecondaryCaptureImageStorage
from pynetdicom import AE
from pynetdicom.association import Association

from services.imaging.devices.association_gate import request_arrives
from services.imaging.devices.dicom_receiver import Endpoint, dicom_receiver
from tests.unit.services.imaging.devices.dicom_samples import dataset_of, grey_ramp

# An image is taken long before the two seconds in which probes end by themselves.
PROMPT_S = 1.5


@contextmanager
def receiving(name: str = "gate", **changes: object) -> Iterator[int]:
    endpoint = Endpoint("127.0.0.1", 0, "DISTALOCK", **changes)  # type: ignore[arg-type]  # by keyword
    log = structlog.stdlib.get_logger("test of gate").bind(receiver=name)
    with dicom_receiver(endpoint, lambda *_: None, log) as port:
        yield port


def associated(port: int, title: str = "CARM") -> Association:
    entity = AE(ae_title=title)
    entity.add_requested_context(SecondaryCaptureImageStorage, ExplicitVRLittleEndian)
    return entity.associate("127.0.0.1", port, ae_title="DISTALOCK")


def deliver(port: int, title: str = "CARM") -> int | None:
    """Status of one image; None when the association is refused."""
    association = associated(port, title)
    if not association.is_established:
        return None
    status = association.send_c_store(dataset_of(grey_ramp()))
    association.release()
    return int(status.Status)


@pytest.mark.parametrize(
    "sent", [b"", b"GET / HTTP/1.0\r\n\r\n", b"\x01\x00\x00\x00\x00\xff", b"\x01\x00\xff\xff\xff\xff"]
)
@pytest.mark.parametrize("stay", [False, True], ids=["closed at once", "held open"])
def test_an_image_comes_through_a_storm_of_probes(sent: bytes, *, stay: bool) -> None:
    with receiving() as port, ExitStack() as held:
        for _ in range(40):
            probe = socket.create_connection(("127.0.0.1", port))
            held.callback(probe.close)
            probe.sendall(sent)
            if not stay:
                probe.close()
        began_s = time.monotonic()
        assert deliver(port) == 0x0000
        assert time.monotonic() - began_s < PROMPT_S


def test_probes_between_images_keep_nobody_out() -> None:
    with receiving(most_associations=2) as port:
        for _ in range(10):
            socket.create_connection(("127.0.0.1", port)).close()
            assert deliver(port) == 0x0000


def test_probes_are_counted_in_the_log_and_do_not_fill_it() -> None:
    with structlog.testing.capture_logs() as lines:
        with receiving("counting") as port:
            for _ in range(15):
                with socket.create_connection(("127.0.0.1", port)) as probe:
                    probe.sendall(b"?" * 80)
                    probe.settimeout(PROMPT_S)
                    assert probe.recv(1) == b"", "closed by the receiver at once"
        # On a busy machine the receiver of the test before may still log what it closed at its end.
        own = [line for line in lines if line.get("receiver") == "counting"]
        told = [line["detail"] for line in own if line["event"] == "connection without an association request"]
    assert [detail.partition(" ")[0] for detail in told] == ["1", "10"]


def test_places_are_kept_for_titles_that_have_sent_an_image() -> None:
    with receiving(most_associations=4) as port:
        assert deliver(port) == 0x0000
        strangers = [associated(port, "SCANNER") for _ in range(3)]
        assert [one.is_established for one in strangers] == [True, True, False]
        assert strangers[2].is_rejected
        assert deliver(port) == 0x0000, "the C-arm finds its place"
        for one in strangers[:2]:
            one.release()
        assert deliver(port, "SCANNER") == 0x0000


def test_places_are_kept_for_other_addresses() -> None:
    with receiving(most_associations=4, calling_ae_titles=("CARM",)) as port:
        open_ones = [associated(port) for _ in range(4)]
        assert [one.is_established for one in open_ones] == [True, True, True, False]
        for one in open_ones[:3]:
            one.release()


def test_ending_does_not_wait_for_those_who_wait() -> None:
    with receiving() as port:
        held = [socket.create_connection(("127.0.0.1", port)) for _ in range(3)]
        began_s = time.monotonic()
    assert time.monotonic() - began_s < PROMPT_S
    for one in held:
        one.close()


@pytest.mark.parametrize(
    ("pieces", "arrives"),
    [
        ([b"\x01\x00\x00\x00\x00\x60" + bytes(96)], True),
        ([b"\x01", b"\x00\x00\x00\x00\x60" + bytes(40), bytes(56)], True),
        ([b"\x01\x00\x00\x00\x00\x60" + bytes(95)], False),
        ([b"\x01\x00\x00\x00\x00\x10" + bytes(16)], False),
    ],
    ids=["whole", "in pieces", "never whole", "too short for titles"],
)
def test_a_request_counts_when_it_is_whole(pieces: list[bytes], *, arrives: bool) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        for piece in pieces:
            theirs.sendall(piece)
        assert request_arrives(ours, 0.2) is arrives
        if arrives:
            assert ours.recv(65536) == b"".join(pieces), "left for the protocol to read"

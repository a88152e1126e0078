"""Images on the wire: to a real DICOM receiver, to one that refuses, and to nobody."""

import hashlib
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime

import numpy as np
import pytest
from pydicom.uid import XRayAngiographicImageStorage
from pynetdicom import AE, evt

from simulation.dicom.image import Acquisition, DicomShot, dicom_shot
from simulation.dicom.sender import ImageNotDelivered, send
from simulation.dicom.target import DicomTarget
from simulation.room.foot_pedal import FootPedal
from simulation.room.operating_room import OperatingRoom
from simulation.scenario.c_arm_angles import CArmAngles
from simulation.world.poses import starting_state
from tests.unit.simulation import rooms


def shot() -> DicomShot:
    taken = Acquisition(datetime(2026, 3, 1, tzinfo=UTC), "1.2.3", "1.2.3.4", 1)
    pixels = np.arange(256 * 256, dtype=np.uint16).reshape(256, 256)
    return dicom_shot(rooms.scenario(), CArmAngles(-90.0, 0.0), pixels, taken)


@contextmanager
def receiver(status: int = 0x0000, title: str = "DISTALOCK") -> Iterator[tuple[DicomTarget, list[bytes]]]:
    """A storage provider that keeps the pixel data it gets."""
    received: list[bytes] = []

    def store(event: evt.Event) -> int:
        received.append(event.dataset.PixelData)
        return status

    entity = AE(ae_title=title)
    entity.require_called_aet = True
    entity.add_supported_context(XRayAngiographicImageStorage)
    server = entity.start_server(("127.0.0.1", 0), block=False, evt_handlers=[(evt.EVT_C_STORE, store)])
    assert server is not None
    assert server.socket is not None
    try:
        yield DicomTarget("127.0.0.1", server.socket.getsockname()[1]), received
    finally:
        server.shutdown()


def test_an_image_arrives_whole() -> None:
    sent = shot()
    with receiver() as (target, received):
        send(sent, target)
    assert [hashlib.sha256(pixels).hexdigest() for pixels in received] == [sent.pixel_sha256]


def test_a_refusal_names_the_status() -> None:
    with (
        receiver(status=0xA700) as (target, _),
        pytest.raises(ImageNotDelivered, match="refused the image with status 0xA700"),
    ):
        send(shot(), target)


def test_a_wrong_title_is_a_refused_association() -> None:
    with (
        receiver(title="OTHER") as (target, _),
        pytest.raises(ImageNotDelivered, match=r"DISTALOCK@127\.0\.0\.1:\d+ refused the association"),
    ):
        send(shot(), target)


def test_nobody_there_is_said_so() -> None:
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    with pytest.raises(ImageNotDelivered, match=r"does not answer \(Connection refused\); start the imaging service"):
        send(shot(), DicomTarget("127.0.0.1", port))


def test_the_foot_pedal_delivers_and_keeps_what_it_could_not_deliver() -> None:
    scenario = rooms.scenario()
    room = OperatingRoom(scenario, lambda: starting_state(scenario).platform)
    with receiver() as (target, received):
        pedal = FootPedal(room, target)
        taken = pedal.press()
    assert taken.delivered_to == target
    assert len(received) == 1
    with pytest.raises(ImageNotDelivered):
        pedal.press()
    assert pedal.last is not None
    assert (pedal.last.number, pedal.last.delivered_to) == (2, None)

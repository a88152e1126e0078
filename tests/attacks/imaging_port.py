"""Attacks on the DICOM port: wrong titles, objects that are broken, grow or lie, connections that ask for nothing."""

import socket
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from io import BytesIO
from typing import Final

from pydicom import Dataset, dcmread, dcmwrite
from pydicom.uid import DeflatedExplicitVRLittleEndian, JPEGLosslessSV1, generate_uid
from pynetdicom import AE, _config
from pynetdicom.association import Association

from tests.attacks.attack import Attack, Record
from tests.attacks.site import PATIENCE_S, Site

_TITLE: Final = "DISTALOCK"
_REJECTED: Final = "rejected"
_REFUSED: Final = "0xC000"
_GROWS_TO_BYTES: Final = 2**30
_SILENT: Final = 40


@contextmanager
def _association(site: Site, called: str, dataset: Dataset) -> Iterator[Association]:
    entity = AE(ae_title="THIEF")
    entity.add_requested_context(dataset.SOPClassUID, dataset.file_meta.TransferSyntaxUID)
    association = entity.associate("127.0.0.1", site.installation.ports.dicom, ae_title=called)
    try:
        yield association
    finally:
        if association.is_established:
            association.release()


def _image(site: Site) -> Dataset:
    """An image of the virtual C-arm under a new name."""
    dataset = dcmread(BytesIO(site.control.get_bytes("/shots/last.dcm")))
    dataset.SOPInstanceUID = dataset.file_meta.MediaStorageSOPInstanceUID = generate_uid()
    return dataset


def _wrong_title(site: Site) -> str:
    with _association(site, "SOMEBODY", _image(site)) as association:
        return _REJECTED if association.is_rejected else "let in"


def _sent(change: Callable[[Dataset], None]) -> Callable[[Site], str]:
    """Send a changed image; the status of the answer."""

    def run(site: Site) -> str:
        dataset = _image(site)
        change(dataset)
        with _association(site, _TITLE, dataset) as association:
            if not association.is_established:
                return "no association"
            return f"0x{association.send_c_store(dataset).Status & 0xF000:04X}"

    return run


def _truncate(dataset: Dataset) -> None:
    dataset.PixelData = dataset.PixelData[:1000]


def _overstate(dataset: Dataset) -> None:
    dataset.Rows = dataset.Columns = 65535


def _lie_about_size(dataset: Dataset) -> None:
    """A compressed picture whose own header states 65000 x 65000."""
    header = b"\xff\xd8\xff\xc3" + struct.pack(">HBHHB", 11, 16, 65000, 65000, 1) + b"\x01\x11\x00"
    frame = header + b"\xff\xda\x00\x08\x01\x01\x00\x01\x00\x00" + bytes(1000) + b"\xff\xd9\x00"
    item = b"\xfe\xff\x00\xe0" + struct.pack("<I", len(frame)) + frame
    dataset.PixelData = b"\xfe\xff\x00\xe0\x00\x00\x00\x00" + item + b"\xfe\xff\xdd\xe0\x00\x00\x00\x00"
    dataset["PixelData"].is_undefined_length = True
    dataset.file_meta.TransferSyntaxUID = JPEGLosslessSV1


def _bomb(site: Site) -> str:
    """An object that grows a thousand times: sent as it lies in its file, or pynetdicom would inflate it here."""
    dataset = _image(site)
    dataset.file_meta.TransferSyntaxUID = DeflatedExplicitVRLittleEndian
    buffer = BytesIO()
    dcmwrite(buffer, dataset, enforce_file_format=True)
    meta_ends = 144 + int.from_bytes(buffer.getvalue()[140:144], "little")
    file = site.scratch / "bomb.dcm"
    file.write_bytes(buffer.getvalue()[:meta_ends] + _deflated_zeros())
    _config.STORE_SEND_CHUNKED_DATASET = True
    try:
        with _association(site, _TITLE, dataset) as association:
            if not association.is_established:
                return "no association"
            return f"0x{association.send_c_store(file).Status & 0xF000:04X}"
    finally:
        _config.STORE_SEND_CHUNKED_DATASET = False


def _deflated_zeros() -> bytes:
    packer, block = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS), bytes(2**20)
    grown = [packer.compress(block) for _ in range(_GROWS_TO_BYTES // len(block))]
    return b"".join([*grown, packer.flush()])


def _silent_connections(site: Site) -> str:
    """Connections that ask for nothing, while an image is sent."""
    with ExitStack() as opened:
        for _ in range(_SILENT):
            address = ("127.0.0.1", site.installation.ports.dicom)
            opened.enter_context(socket.create_connection(address, PATIENCE_S))
        return _sent(lambda _: None)(site)


def _imaging(text: str) -> Record:
    return Record("imaging", text)


_PORT: Final = "access to the DICOM port"

ATTACKS: Final = (
    Attack(
        "DICOM under a wrong title",
        _PORT,
        "an association that calls another application entity title",
        _REJECTED,
        _imaging("association rejected"),
        _wrong_title,
    ),
    Attack(
        "truncated image",
        _PORT,
        "an object whose pixels end early",
        _REFUSED,
        _imaging("image refused"),
        _sent(_truncate),
    ),
    Attack(
        "overstated image",
        _PORT,
        "an object that states 65535 x 65535 pixels",
        _REFUSED,
        _imaging("image refused"),
        _sent(_overstate),
    ),
    Attack(
        "lying image",
        _PORT,
        "a compressed picture of 65000 x 65000 pixels in an object that states an image's size",
        _REFUSED,
        _imaging("the compressed picture is of 65000 x 65000"),
        _sent(_lie_about_size),
    ),
    Attack(
        "decompression bomb",
        _PORT,
        f"a deflated object of 1 MB that grows to {_GROWS_TO_BYTES // 2**30} GiB",
        _REFUSED,
        _imaging("grows beyond"),
        _bomb,
    ),
    Attack(
        "silent connections",
        _PORT,
        f"{_SILENT} connections that ask for nothing, while an image is sent",
        "0x0000",
        _imaging("connection without an association request"),
        _silent_connections,
    ),
)

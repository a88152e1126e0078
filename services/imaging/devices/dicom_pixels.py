"""What the stored values of a DICOM image mean: polarity, unused bits, colours that are grey.

Polarity: PixelIntensityRelationshipSign (0028,1041) says whether low stored values mean little X-ray (+1: darker is
denser) or much (-1). Without it, what is shown decides: MONOCHROME1, or an inverse presentation LUT shape, shows high
values dark, and a falling rescale slope or a falling modality LUT turns that round. The first two state one inversion:
the shape of MONOCHROME1 is INVERSE (PS3.3 C.7.6.1). Windows and other rising LUTs are left alone: they are monotone,
and measuring assumes no more. Overlays are no part of the values, but old ones lie in bits beside the stored ones.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from pydicom.dataset import Dataset
from pydicom.pixels.utils import iter_pixels
from pydicom.uid import RLELossless

from services.imaging.core.tuning import SCREEN_COPIES
from services.imaging.devices.decoded_size import stated_frames
from shared.errors import ImageUnreadable

_GREY = ("MONOCHROME1", "MONOCHROME2")
_COLOUR = ("RGB", "YBR_FULL", "YBR_FULL_422", "YBR_ICT", "YBR_RCT")
# ITU-R BT.601, which DICOM's YBR colour spaces use.
_LUMINANCE = np.array([0.299, 0.587, 0.114], dtype=np.float32)


def grey_frames(dataset: Dataset, source: str) -> Iterator[NDArray[np.float32]]:
    """Grey values frame by frame, reversed when the tags say that bright is dense.

    One frame at a time is decoded: all of a run at once would take several times its file's size.

    Parameters
    ----------
    dataset
        The whole object.
    source
        For the error's sentence.

    Yields
    ------
    NDArray
        Shape (rows, columns).

    Raises
    ------
    ImageUnreadable
        When a frame has colours, when stored values cannot lie where the object states, or when there are fewer
        frames than it states.
    """
    if dataset.get("PhotometricInterpretation") in _GREY:
        _require_high_bit(dataset, source)
    count = 0
    for stored in iter_pixels(dataset, correct_unused_bits=False):  # it ignores HighBit
        count += 1
        yield _grey(dataset, stored, source)
    stated = stated_frames(dataset)
    if count < stated:
        raise ImageUnreadable(f"{source}: the object states {stated} frames and has {count}; send it again")


def _grey(dataset: Dataset, stored: NDArray[np.generic], source: str) -> NDArray[np.float32]:
    """One frame as pydicom decodes it, colours last."""
    photometric, samples = str(dataset.get("PhotometricInterpretation", "missing")), stored.shape[2:]
    if photometric in _GREY and not samples:
        values = _without_unused_bits(dataset, stored).astype(np.float32)
    elif photometric in _COLOUR and samples == (3,):
        values = _grey_of_colours(stored, source)
    else:
        found = f"{photometric} of {samples[0]} values a pixel" if samples else photometric
        raise ImageUnreadable(f"{source}: the photometric interpretation is {found}; needed is {' or '.join(_GREY)}")
    if not _bright_is_dense(dataset):
        return values
    if int(dataset.get("PixelRepresentation", 0)) == 1:
        return -values
    return np.float32(2 ** int(dataset.BitsStored) - 1) - values


def _require_high_bit(dataset: Dataset, source: str) -> None:
    """Check where stored values end; above the usual bit only where they lie as stored, not in a JPEG picture."""
    bits, allocated, high = int(dataset.BitsStored), int(dataset.BitsAllocated), _high_bit(dataset)
    syntax = dataset.file_meta.TransferSyntaxUID
    last = bits - 1 if syntax.is_encapsulated and syntax != RLELossless else allocated - 1
    if not bits - 1 <= high <= last:
        raise ImageUnreadable(
            f"{source}: the high bit of {bits} stored bits in {allocated} is {high} ({bits - 1} to {last} in "
            f"{syntax.name}); correct Bits Stored and High Bit, or send the image uncompressed"
        )


def _high_bit(dataset: Dataset) -> int:
    high = dataset.get("HighBit")
    return int(dataset.BitsStored) - 1 if high is None else int(high)


def _without_unused_bits(dataset: Dataset, stored: NDArray[np.generic]) -> NDArray[np.generic]:
    """Values without the bits beside the stored ones, where old devices keep overlays."""
    bits, size = int(dataset.BitsStored), 8 * stored.dtype.itemsize
    if bits >= size:
        return stored
    moved_up = np.left_shift(stored, size - 1 - _high_bit(dataset))
    return np.asarray(np.right_shift(moved_up, size - bits))  # of signed values the sign comes back


def _grey_of_colours(stored: NDArray[np.generic], source: str) -> NDArray[np.float32]:
    """Luminance of a screen's copy of a grey image; little coloured text is allowed."""
    values = stored.astype(np.float32)
    coloured, most = (
        float(np.mean(np.ptp(values, axis=-1) > SCREEN_COPIES.coloured_levels)),
        SCREEN_COPIES.most_coloured,
    )
    if coloured > most:
        raise ImageUnreadable(
            f"{source}: {100 * coloured:.0f} % of the pixels are coloured (limit {100 * most:.0f} %); "
            "send the X-ray image itself, in grey values"
        )
    return np.asarray(values @ _LUMINANCE, dtype=np.float32)


def _bright_is_dense(dataset: Dataset) -> bool:
    sign = dataset.get("PixelIntensityRelationshipSign")
    if sign is not None:
        return int(sign) < 0
    turns: list[bool] = [
        str(dataset.PhotometricInterpretation) == "MONOCHROME1"
        or str(dataset.get("PresentationLUTShape", "")) == "INVERSE",
        float(dataset.get("RescaleSlope", 1.0) or 1.0) < 0.0,
        _falls(dataset),
    ]
    return sum(turns) % 2 == 1


def _falls(dataset: Dataset) -> bool:
    """Whether the modality LUT, when there is one, falls from its first to its last entry."""
    tables = dataset.get("ModalityLUTSequence")
    if not tables:
        return False
    data = tables[0].get("LUTData", b"")
    entries = np.frombuffer(data, "<u2") if isinstance(data, bytes) else np.atleast_1d(np.asarray(data))
    return bool(entries.size > 1 and entries[-1] < entries[0])

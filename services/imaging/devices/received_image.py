"""An image as the services see it, whatever kind of file it came in."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

GreyPixels = NDArray[np.uint8] | NDArray[np.uint16]

LONGEST_SIDE: Final = 8192
"""Of an image, in pixels: more is no X-ray image, but would keep a decoder busy for long."""


@dataclass(frozen=True, slots=True)
class Acquisition:
    """What the file says of how the image was made; None where it says nothing.

    Attributes
    ----------
    source_to_detector_mm, pixel_mm
        Nominal distance, and nominal pixel size at the detector.
    positioner_primary_angle_deg, positioner_secondary_angle_deg
        Angles of the C-arm.
    """

    manufacturer: str = ""
    model_name: str = ""
    source_to_detector_mm: float | None = None
    pixel_mm: float | None = None
    positioner_primary_angle_deg: float | None = None
    positioner_secondary_angle_deg: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ImageContent:
    """Pixels of an image file, and what the file says of them.

    Attributes
    ----------
    pixels
        Grey values, darker is denser, shape (rows, columns).
    """

    pixels: NDArray[np.float32]
    acquisition: Acquisition


@dataclass(frozen=True, slots=True, eq=False)
class ReceivedImage:
    """One grey image, normalised so that darker (smaller) is denser.

    Attributes
    ----------
    pixels
        Stored grey values, shape (rows, columns); reversed when the file is tagged with the other polarity.
    bits_stored
        Bits of each value.
    dicom
        The file as DICOM: as received, or made from another format.
    sop_instance_uid
        The DICOM object's unique identifier.
    """

    pixels: NDArray[np.float32]
    bits_stored: int
    dicom: bytes
    sop_instance_uid: str
    acquisition: Acquisition

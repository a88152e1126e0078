"""An image as the services see it, whatever kind of file it came in."""

from dataclasses import dataclass, replace
from enum import Enum, StrEnum
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

GreyPixels = NDArray[np.uint8] | NDArray[np.uint16]

LONGEST_SIDE: Final = 8192
"""Of an image, in pixels: more is no X-ray image, but would keep a decoder busy for long."""


class Polarity(Enum):
    """What bright means in images."""

    AS_TAGGED = "as the file states; PNG and TIFF: darker is denser"
    INVERTED = "the opposite of what the file states"

    def normalised(self, read: NDArray[np.float32]) -> NDArray[np.float32]:
        """Grey values of a file as read, shape (rows, columns), made darker where it is denser, in the same range."""
        return read if self is Polarity.AS_TAGGED else np.asarray(read.max() + read.min() - read)


class HeaderValue(StrEnum):
    """DICOM attributes that the measurement uses."""

    SOURCE_TO_DETECTOR = "DistanceSourceToDetector (0018,1110)"
    PIXEL = "ImagerPixelSpacing (0018,1164)"
    FOCAL_SPOT = "FocalSpots (0018,1190)"


BOUNDS_MM: Final = {
    HeaderValue.SOURCE_TO_DETECTOR: (500.0, 2000.0),
    HeaderValue.PIXEL: (0.05, 2.0),
    HeaderValue.FOCAL_SPOT: (0.05, 3.0),
}
"""Least and greatest possible values, in mm."""


@dataclass(frozen=True, slots=True)
class UnusableValue:
    """A value of an image file's header that cannot be used; the sentence states it, and the limits."""

    attribute: HeaderValue
    sentence: str


@dataclass(frozen=True, slots=True)
class Acquisition:
    """What the file says of how the image was made; None where it says nothing.

    Attributes
    ----------
    source_to_detector_mm, pixel_mm
        Nominal distance, and nominal pixel size at the detector.
    positioner_primary_angle_deg, positioner_secondary_angle_deg
        Angles of the C-arm.
    focal_spot_mm
        Edge of the focal spot.
    laterality
        Side of the body that was imaged.
    unusable
        What the file states and what cannot be right; the value itself is then None.
    """

    manufacturer: str = ""
    model_name: str = ""
    source_to_detector_mm: float | None = None
    pixel_mm: float | None = None
    positioner_primary_angle_deg: float | None = None
    positioner_secondary_angle_deg: float | None = None
    focal_spot_mm: float | None = None
    laterality: Literal["left", "right"] | None = None
    unusable: tuple[UnusableValue, ...] = ()

    def why_unusable(self, attribute: HeaderValue) -> str | None:
        """Why the file's value cannot be used; None where it can, or where there is none."""
        return next((one.sentence for one in self.unusable if one.attribute is attribute), None)


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

    def normalised(self, polarity: Polarity) -> "ReceivedImage":
        """The same image by what a person states of its polarity."""
        return replace(self, pixels=polarity.normalised(self.pixels))

"""Nominal values of one image: what a person states goes before the image's header, the header before defaults."""

from dataclasses import dataclass

from services.imaging.core.nominal import NominalGeometry
from services.imaging.devices.received_image import Acquisition, HeaderValue
from shared.errors import ImageUnreadable

# Chosen: headers round, so values that agree within 1 % are taken as one.
_SAME = 0.01


@dataclass(frozen=True, slots=True)
class StatedValues:
    """Nominal values that a person states, by an option or in a case; None where nothing is stated."""

    source_to_detector_mm: float | None = None
    pixel_mm: float | None = None
    focal_spot_mm: float | None = None


@dataclass(frozen=True, slots=True)
class ImageNominal:
    """Nominal values of one image, and sentences that name what was ignored and what was assumed."""

    geometry: NominalGeometry
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Chosen:
    value: float | None
    notes: tuple[str, ...]


def nominal_of_image(stated: StatedValues, image: Acquisition, default: NominalGeometry) -> ImageNominal:
    """Choose the nominal values of an image.

    Raises
    ------
    ImageUnreadable
        When distance or pixel size is not stated and the header's cannot be right.
    """
    source = _chosen(
        HeaderValue.SOURCE_TO_DETECTOR,
        image,
        (stated.source_to_detector_mm, image.source_to_detector_mm, default.source_to_detector_mm),
        "--source-to-detector-mm, in a case nominal_source_to_detector_mm",
    )
    pixel = _chosen(
        HeaderValue.PIXEL,
        image,
        (stated.pixel_mm, image.pixel_mm, default.pixel_mm),
        "--pixel-mm, in a case nominal_pixel_mm",
    )
    spot = _chosen(HeaderValue.FOCAL_SPOT, image, (stated.focal_spot_mm, image.focal_spot_mm, None), "")
    assert source.value is not None, "it has a default"
    assert pixel.value is not None, "it has a default"
    return ImageNominal(
        NominalGeometry(source.value, pixel.value, spot.value), (*source.notes, *pixel.notes, *spot.notes)
    )


def _chosen(
    attribute: HeaderValue, image: Acquisition, values: tuple[float | None, float | None, float | None], option: str
) -> _Chosen:
    """The first of the values stated by a person, by the header and assumed; `option` states the first."""
    stated, header, assumed = values
    unusable = image.why_unusable(attribute)
    if stated is not None:
        if unusable is not None:
            return _Chosen(stated, (f"{unusable} and is ignored: {stated:g} mm is stated",))
        if header is not None and abs(header - stated) > _SAME * stated:
            return _Chosen(stated, (f"{attribute.value} is {header:g} mm and is ignored: {stated:g} mm is stated",))
        return _Chosen(stated, ())
    if unusable is not None and option:
        raise ImageUnreadable(f"{unusable}; correct the header, or state the true value ({option})")
    if unusable is not None:
        return _Chosen(assumed, (f"{unusable} and is ignored",))
    if header is not None or assumed is None:
        return _Chosen(header, ())
    name = attribute.value.partition(" ")[0]
    return _Chosen(assumed, (f"{name} is assumed to be {assumed:g} mm: neither a person nor the image states it",))

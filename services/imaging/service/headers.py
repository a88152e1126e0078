"""The header of a received image: what the case, the image and the settings say of how it was made."""

from dataclasses import dataclass

from services.imaging.core.nominal import NominalGeometry
from services.imaging.devices.nominal_values import StatedValues, nominal_of_image
from services.imaging.devices.received_image import Polarity, ReceivedImage
from shared.messages.cases import CaseContext
from shared.messages.imaging import FrameHeader


@dataclass(frozen=True, slots=True)
class Defaults:
    """Nominal values when neither the case nor the image says any, and the polarity of all images."""

    source_to_detector_mm: float
    pixel_mm: float
    polarity: Polarity = Polarity.AS_TAGGED


@dataclass(frozen=True, slots=True)
class ImageNumber:
    """Names an image: the store that numbers it, its number there, and the run of imaging that received it."""

    store_id: str
    sequence: int
    boot_epoch: str


Moment = tuple[int, float]
"""Unix time in ns, for people, and monotonic time in s."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """When an image was received.

    Attributes
    ----------
    number
        In the image store.
    received_at_ns
        Unix time, for people.
    received_at_s
        Monotonic time: what the next arrival and the image's age are reckoned from.
    run_interval_s
        Longest time between two images of a run when this one is part of a run, otherwise None.
    """

    number: ImageNumber
    received_at_ns: int
    received_at_s: float
    run_interval_s: float | None

    @staticmethod
    def after(previous: "Arrival | None", number: ImageNumber, received: Moment, run_interval_s: float) -> "Arrival":
        """The next arrival: part of a run when it follows the previous one within `run_interval_s`.

        One that was received before the image with the number before, and took longer to read, follows none.
        """
        unix_ns, monotonic_s = received
        if previous is None:
            return Arrival(number, unix_ns, monotonic_s, None)
        in_run = 0.0 <= monotonic_s - previous.received_at_s < run_interval_s
        return Arrival(number, unix_ns, monotonic_s, run_interval_s if in_run else None)


def frame_header(
    image: ReceivedImage, sha256: str, arrival: Arrival, case: CaseContext | None, defaults: Defaults
) -> FrameHeader:
    """The header; of nominal values, the case goes before the image, the image before the defaults.

    Raises
    ------
    ImageUnreadable
        When the case states no distance or pixel size and the image's cannot be right.
    """
    made = image.acquisition
    stated = StatedValues(
        None if case is None else case.nominal_source_to_detector_mm, None if case is None else case.nominal_pixel_mm
    )
    nominal = nominal_of_image(stated, made, NominalGeometry(defaults.source_to_detector_mm, defaults.pixel_mm))
    rows, columns = image.pixels.shape
    return FrameHeader(
        sha256=sha256,
        sop_instance_uid=image.sop_instance_uid,
        sequence=arrival.number.sequence,
        store_id=arrival.number.store_id,
        boot_epoch=arrival.number.boot_epoch,
        received_at_ns=arrival.received_at_ns,
        width_px=columns,
        height_px=rows,
        bits_stored=image.bits_stored,
        case_id=case.case_id if case else None,
        case_revision=case.revision if case else 0,
        manufacturer=made.manufacturer,
        model_name=made.model_name,
        nominal_source_to_detector_mm=nominal.geometry.source_to_detector_mm,
        nominal_pixel_mm=nominal.geometry.pixel_mm,
        focal_spot_mm=nominal.geometry.focal_spot_mm,
        notes=nominal.notes,
        inverted=defaults.polarity is Polarity.INVERTED,
        positioner_primary_angle_deg=made.positioner_primary_angle_deg,
        positioner_secondary_angle_deg=made.positioner_secondary_angle_deg,
        laterality=made.laterality,
        run_interval_s=arrival.run_interval_s,
    )


def polarity_of(header: FrameHeader) -> Polarity:
    """By which the stored file becomes the pixels that were published."""
    return Polarity.INVERTED if header.inverted else Polarity.AS_TAGGED


def angles_deg(header: FrameHeader) -> tuple[float, float] | None:
    """The C-arm's angles, when the image names both."""
    primary, secondary = header.positioner_primary_angle_deg, header.positioner_secondary_angle_deg
    return None if primary is None or secondary is None else (primary, secondary)

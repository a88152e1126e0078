"""What was found in an image as vectors, for viewers: projected by registration, so that no page computes geometry."""

from typing import Annotated, Literal

from pydantic import Field

from shared.messages.base import Finite, Message, MessageModel, Pixel, Sha256

Polyline = tuple[Pixel, ...]
Length = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class DrawnBall(MessageModel):
    """A ball of ring or guide."""

    id: str
    centre_px: Pixel = Field(description="Where it was measured; of a ball that was not used, where it must be.")
    radius_px: Length
    used: bool = Field(description="Whether calibration or guide pose rests on it.")
    residual_px: Length | None = Field(
        description="Distance from where calibration and pose predict it; null for a ball that was not used."
    )


class DrawnEllipse(MessageModel):
    """An ellipse in pixels."""

    centre_px: Pixel
    semi_major_px: Length
    semi_minor_px: Length
    major_axis_deg: Finite = Field(description="Direction of the major axis, from the columns' to the rows' direction.")


class DrawnHole(MessageModel):
    """A hole of the nail.

    Attributes
    ----------
    mm_per_px
        Length at the hole's depth that one pixel covers.
    entry_95, exit_95
        95 % ellipses of where the hole's axis crosses its entry and its exit, against the guide. None of a hole that is
        not localised, and where the errors are not estimated.
    """

    id: str
    localised: bool
    centre_px: Pixel
    mm_per_px: Length
    rims_px: tuple[Polyline, Polyline] = Field(description="Where it meets the nail's surface, at entry and exit.")
    axis_px: Polyline = Field(description="From the surgeon's side to the exit.")
    entry_95: DrawnEllipse | None
    exit_95: DrawnEllipse | None


class DrawnPath(MessageModel):
    """Where a drill goes that is led by the guide's hole of this name, as the guide stands in the image."""

    id: str
    axis_px: Polyline = Field(description="From the surgeon's side to where it leaves the nail.")
    edges_px: tuple[Polyline, Polyline] = Field(description="Both sides of the drill.")
    rims_px: tuple[Polyline, ...] = Field(
        description="The drill's circumference in the planes of the nail hole's entry and exit; empty without a nail."
    )


class DrawnScrew(MessageModel):
    """A screw of the mount where it is advised."""

    id: Literal["distal", "proximal"]
    shown: bool
    axis_px: Polyline
    radius_px: Length


class Drawing(MessageModel):
    """Everything in the pixels of one view."""

    ring_balls: tuple[DrawnBall, ...]
    guide_balls: tuple[DrawnBall, ...]
    nail_edges_px: tuple[Polyline, ...] = Field(description="The nail's two sides; empty without a nail.")
    holes: tuple[DrawnHole, ...]
    drill_paths: tuple[DrawnPath, ...]
    mounting_screws: tuple[DrawnScrew, ...]


class ImageDrawing(Message):
    """An image's drawing, in the pixels of the image as received and of the corrected one; both un-mirrored.

    Attributes
    ----------
    mirrored
        Column x is then column ``width_px - 1 - x`` of the image as received.
    mm_per_px_at_detector
        Length that one pixel covers at the ring's plate next to the detector.
    """

    schema_name: Literal["distalock/drawing/1"] = Field("distalock/drawing/1", alias="schema")
    image_sha256: Sha256
    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    mirrored: bool
    mm_per_px_at_detector: Length
    raw: Drawing
    corrected: Drawing

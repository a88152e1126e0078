"""Frames that only the virtual operating room knows."""

from shared.geometry.frames import Frame


class Detector(Frame):
    """The C-arm's detector: origin at its middle, +z away from the source, +x along columns, +y along rows.

    Columns and rows are those of the detector, before the display turns or mirrors the image.
    """


class Beam(Frame):
    """Origin at the focal spot, axes parallel to `Detector`: the camera's frame before the display's rotation."""

"""Names of the coordinate frames, as phantom types for `Transform`.

None of these is ever instantiated: they only let the type checker refuse a product of transforms in the wrong order.
"""


class Frame:
    """Root of all frames."""


class Camera(Frame):
    """Origin at the focal spot, +z to the detector, +x along columns and +y along rows of the (unmirrored) image."""


class Ring(Frame):
    """Calibration ring: origin on the plate next to the detector, +z towards the detector."""


class Guide(Frame):
    """Drill guide: +z = direction of drilling, +x = distal along the nail."""


class Nail(Frame):
    """Nail: origin midway between the holes on the nail's axis, +x = distal, +z = hole axis, direction of drilling."""


class RobotBase(Frame):
    """Hexapod's base plate."""


class RobotTop(Frame):
    """Hexapod's moving platform."""


class Bone(Frame):
    """Distal bone fragment."""


class Room(Frame):
    """Operating room."""

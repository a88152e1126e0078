"""Equipment that is usual unless a case or the command line says otherwise."""

from typing import Final, Literal

# Into which nails are made to go, and which are locked with this product.
Bone = Literal["femur", "tibia"]

# Of the drills for 5 mm interlocking screws.
USUAL_DRILL_DIAMETER_MM: Final = 4.0
# Required: one drill in a hundred may touch the wall of the nail's hole.
LEAST_CHANCE_TO_PASS: Final = 0.99
# K-wires through the guide's holes.
USUAL_WIRE_DIAMETER_MM: Final = 2.0

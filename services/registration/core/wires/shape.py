"""A wire in one view: its discs and their outline, for given unknowns of the wire and of the view."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.wires.model import SHARED, WireModel
from services.registration.core.wires.outline import Outline, Stack, outline_of
from services.registration.core.wires.view import PreparedView

PER_VIEW = 7
# Farther apart, the likelihood of one place would depend by some nats on which points of the outline happen to be read.
_LEAST_DISCS, _MOST_DISCS, _DISC_EVERY_PX = 12, 500, 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A wire's outline in one view.

    Attributes
    ----------
    free
        How much of each point can be seen, and counts, from 0 to 1, shape (M,).
    """

    stack: Stack
    outline: Outline
    free: NDArray[np.float64]

    @property
    def free_px(self) -> NDArray[np.float64]:
        """Length of outline that each point stands for and that can be seen, shape (M,)."""
        return self.outline.length_px * self.free


def stacks_of(view: PreparedView, model: WireModel, unknowns: NDArray[np.float64], count: int) -> Stack:
    """Discs along wires: centres of shape (B, count, 2), radii of shape (B, count).

    Parameters
    ----------
    unknowns
        Shape (B, 13): of the wire (see `WireModel`), then the error of the apparent radius in this view (px), then that
        of the guide's pose (rad, mm, in the guide's own frame).
    """
    points = model.points_guide_mm(unknowns[:, :SHARED], count)
    turn, shift = unknowns[:, None, SHARED + 1 : SHARED + 4], unknowns[:, None, SHARED + 4 :]
    # The guide's pose is wrong by a hundredth of a degree: the turn's first order is exact to nanometres.
    points_camera = view.camera_points_mm(points + np.cross(turn, points) + shift)
    calibration = view.view.calibration
    distance = np.linalg.norm(points_camera, axis=-1)
    radius = model.radius_mm * calibration.camera.focal_length_px / distance + unknowns[:, SHARED, None]
    return Stack(calibration.image_from_camera(points_camera), radius)


def shape_of(view: PreparedView, model: WireModel, unknowns: NDArray[np.float64]) -> Shape:
    """Outline of one wire, by a disc every pixel and a half."""
    rough = stacks_of(view, model, unknowns[None], 3).centre_px[0]
    way_px = float(np.linalg.norm(np.diff(rough, axis=0), axis=1).sum())
    discs = int(np.clip(way_px / _DISC_EVERY_PX, _LEAST_DISCS, _MOST_DISCS))
    stacks = stacks_of(view, model, unknowns[None], discs)
    return shape_in(view, Stack(stacks.centre_px[0], stacks.radius_px[0]))


def shape_in(view: PreparedView, stack: Stack) -> Shape:
    """Outline of one stack of discs."""
    outline = outline_of(stack)
    # The cap at the begin of the wire does not count: where it is, nobody knows.
    free = view.free_share(outline.point_px) * (outline.disc > 0)
    return Shape(stack, outline, free)

"""What is known of one set-up before its wires are looked at: the guide in each image, the nail in the guide's frame.

The errors of both belong together: where the nail's place comes from an image, the guide's error in that image is in
it. Whoever compares a wire, found with the help of the guide, with the nail's holes must know that.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.fusion.fuse import FusedPose
from services.registration.core.pose_evidence import motion_of_nail, moved_by
from services.registration.core.wires.view import WireView
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import read_only
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class SetUp:
    """Images of one set-up with the guide's pose in each, and the nail in the guide's frame.

    Attributes
    ----------
    covariance
        Of small motions (rotation in rad, translation in mm): of the guide in its own frame in the first view, in the
        second ..., and of the nail in its own frame; shape (6 V + 6, 6 V + 6).
    """

    views: tuple[WireView, ...]
    guide_from_nail: Transform[Guide, Nail]
    covariance: NDArray[np.float64]

    def __post_init__(self) -> None:
        size = 6 * len(self.views) + 6
        if self.covariance.shape != (size, size):
            raise ValueError(f"expected a covariance of shape ({size}, {size}), got {self.covariance.shape}")
        object.__setattr__(self, "covariance", read_only(self.covariance))

    @property
    def nail_covariance(self) -> NDArray[np.float64]:
        """Of `guide_from_nail`, shape (6, 6)."""
        return self.covariance[-6:, -6:]

    def camera_from_nail(self, view: int) -> Transform[Camera, Nail]:
        """Where the nail is in one view."""
        return self.views[view].camera_from_guide @ self.guide_from_nail

    def moved(self, motion: NDArray[np.float64], covariance: NDArray[np.float64]) -> "SetUp":
        """Everything after small motions, shape (6 V + 6,), with the covariance that is left."""
        views = []
        for k, view in enumerate(self.views):
            own = motion[6 * k : 6 * k + 6]
            step: Transform[Guide, Guide] = Transform.from_rotvec(own[:3], own[3:])
            views.append(
                WireView(
                    view.pixels,
                    view.calibration,
                    view.camera_from_guide @ step,
                    covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6],
                )
            )
        return SetUp(tuple(views), moved_by(self.guide_from_nail, motion[-6:]), covariance)


def set_up_of(views: tuple[WireView, ...], joint: FusedPose, source: tuple[int | None, ...]) -> SetUp:
    """Put the views together with what several images, or one, said of the nail.

    Parameters
    ----------
    source
        For each view, which of the images of `joint` it is; None for an image in which the nail could not be found.
    """
    size = 6 * len(views) + 6
    covariance = np.zeros((size, size))
    covariance[-6:, -6:] = joint.covariance
    by_guide = motion_of_nail(joint.guide_from_nail)
    for k, (view, image) in enumerate(zip(views, source, strict=True)):
        own = slice(6 * k, 6 * k + 6)
        covariance[own, own] = view.guide_covariance
        if image is not None:
            # The image's pose has the guide's error, seen from the nail, with the sign turned round.
            covariance[own, -6:] = -view.guide_covariance @ by_guide.T @ joint.weights[image].T
            covariance[-6:, own] = covariance[own, -6:].T
    return SetUp(views, joint.guide_from_nail, covariance)

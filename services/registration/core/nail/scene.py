"""What is fixed while the nail is fitted: window, camera, the nail's shape, and how image and model are compared."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.blur import Real
from services.registration.core.nail.noise import Whitening
from services.registration.core.nail.pose import POSE_SIZE, Anchors, pose_from_parameters
from services.registration.core.nail.window import Window
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class NailScene:
    """All that is fixed during a fit: the window, the camera and the nail's nominal shape.

    Attributes
    ----------
    whitening
        Filter that image and model both go through.
    """

    window: Window
    camera: PinholeCamera
    anchors: Anchors
    nail: NailPart
    whitening: Whitening | None

    def compared(self, picture: NDArray[Real]) -> NDArray[np.float64]:
        """The strip's pixels, shape (N,), of a picture of the window, whitened when the scene says so."""
        if self.whitening is None:
            return self.window.strip(picture)
        return self.window.strip(self.whitening.apply(picture))

    @property
    def grey(self) -> NDArray[np.float64]:
        """Measured grey values that the model is compared with, shape (N,)."""
        return self.compared(self.window.grey)

    def pose(self, parameters: NDArray[np.float64]) -> Transform[Camera, Nail]:
        """`camera_from_nail` that the parameters stand for."""
        return pose_from_parameters(parameters[:POSE_SIZE], self.camera, self.anchors)


def nail_scene(window: Window, camera: PinholeCamera, anchors: Anchors, nail: NailPart) -> NailScene:
    """Scene as it is before anything has been learned from a fit."""
    return NailScene(window, camera, anchors, nail, None)

"""What the pixels of the window should show: how much of the background each pixel sees past guide, nail and balls.

The grey value of a pixel is  background * visible + floor * (1 - visible). `visible` follows from what lies on the
ray, metal (`shade.py`) and the guide's body, exp(-mu * path): blurred, bent by the display's curve, sharpened by edge
enhancement.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.display import (
    OF_DISPLAY,
    OF_SHARPENING,
    Display,
    derivative_before_sharpening,
    derivative_of_sharpening,
    display_of,
)
from services.registration.core.nail.scene import NailScene
from services.registration.core.nail.tracing import Paths, derivatives_of_paths
from services.registration.core.nail.unknowns import Unknown
from shared.two_cores import mapped

# Pictures with fewer pixels in all are done sooner than handed to another core.
_LEAST_PX = 100_000


def visible_share(scene: NailScene, traced: Paths) -> NDArray[np.float64]:
    """Share of the background that each compared pixel sees, shape (N,); from single precision, which is plenty."""
    passed = (traced.passed * _guide_share(scene, traced.parameters)).astype(np.float32)
    return scene.compared(display_of(scene.window, traced.parameters).shown(passed))


def share_without_metal(scene: NailScene, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same if nothing but the guide's body were there, shape (N,)."""
    guide = _guide_share(scene, parameters).astype(np.float32)
    return scene.compared(display_of(scene.window, parameters).shown(guide))


def derivatives_of_share(scene: NailScene, traced: Paths, free: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """Derivatives of `visible_share` by the free parameters, in their order."""
    display, guide = display_of(scene.window, traced.parameters), _guide_share(scene, traced.parameters)
    passed = traced.passed * guide
    stages = display.stages(passed)
    slope = display.slope(stages).astype(np.float32)
    thin = guide.astype(np.float32)
    least = 2 + _LEAST_PX // passed.size

    once_sharpened = _compared_once_sharpened(scene, display)

    def by_passed(change: NDArray[np.float32]) -> NDArray[np.float64]:
        return once_sharpened(slope * display.blurred(change))

    def by_display(unknown: Unknown) -> NDArray[np.float64]:
        of_display = unknown, scene.window, traced.parameters
        if unknown in OF_SHARPENING:
            return scene.compared(derivative_of_sharpening(*of_display, display, stages))
        return once_sharpened(derivative_before_sharpening(*of_display, passed, display, stages))

    columns = mapped(lambda p: by_passed(p * thin), derivatives_of_paths(scene, traced, free), least)
    columns += mapped(by_display, [unknown for unknown in OF_DISPLAY if free[unknown]], least)
    if free[Unknown.DELRIN_PER_MM]:
        columns.append(by_passed((-scene.window.delrin_excess_mm * passed).astype(np.float32)))
    return columns


def _compared_once_sharpened(
    scene: NailScene, display: Display
) -> Callable[[NDArray[np.float32]], NDArray[np.float64]]:
    """What `NailScene.compared` makes of a picture after edge enhancement; the scene's filter takes both in one."""
    if scene.whitening is None:
        return lambda picture: scene.compared(display.sharpened(picture))
    both = scene.whitening.after(display.sharpened)
    return lambda picture: scene.window.strip(both.apply(picture))


def _guide_share(scene: NailScene, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the X-rays that pass the guide's body, over the usual one (1 in most places), shape (rows, columns)."""
    return np.asarray(np.exp(-parameters[Unknown.DELRIN_PER_MM] * scene.window.delrin_excess_mm))

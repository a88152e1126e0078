"""What the pixels of the window should show: how much of the background each pixel sees past nail and balls.

The grey value of a pixel is  background * visible + floor * (1 - visible). `visible` follows from the metal on the
ray: transmission exp(-(mu * path)^power), blurred, bent by the display's curve, sharpened by edge enhancement.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.display import OF_DISPLAY, derivative_of_display, display_of
from services.registration.core.nail.scene import NailScene
from services.registration.core.nail.tracing import Paths, derivatives_of_paths
from services.registration.core.nail.unknowns import Unknown
from shared.two_cores import mapped

# Pictures with fewer pixels in all are done sooner than handed to another core.
_LEAST_PX = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """Per compared pixel, shape (N,): share of the background that is seen, and what the guide's body leaves of it."""

    visible: NDArray[np.float64]
    delrin: NDArray[np.float64]


def render(scene: NailScene, traced: Paths) -> Appearance:
    """How the window looks."""
    display = display_of(scene, traced.parameters)
    delrin = np.exp(-traced.parameters[Unknown.DELRIN_PER_MM] * scene.body_mm)
    return Appearance(scene.compared(display.stages(traced.passed).sharpened), delrin)


def derivatives(scene: NailScene, traced: Paths, look: Appearance, free: NDArray[np.bool_]) -> list[Appearance]:
    """Derivatives of the appearance by the free parameters, in their order; in single precision, which is plenty."""
    display = display_of(scene, traced.parameters)
    stages = display.stages(traced.passed)
    slope = display.slope(stages.blurred).astype(np.float32)
    least = 2 + _LEAST_PX // traced.passed.size
    by_paths = mapped(
        lambda p: scene.compared(display.sharpened(slope * display.blurred(p))),
        derivatives_of_paths(scene, traced, free),
        least,
    )
    by_display = mapped(
        lambda unknown: scene.compared(
            derivative_of_display(unknown, scene, traced.parameters, traced.passed, display, stages)
        ),
        [unknown for unknown in OF_DISPLAY if free[unknown]],
        least,
    )
    unchanged = np.zeros_like(look.visible)
    columns = [Appearance(visible.astype(np.float64), unchanged) for visible in (*by_paths, *by_display)]
    if free[Unknown.DELRIN_PER_MM]:
        columns.append(Appearance(unchanged, -scene.body_mm * look.delrin))
    return columns

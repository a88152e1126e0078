"""What a kind is: its name, and how it makes its scene of a seed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from benchmarks.robustness.scene import ImageFolder, RobustScene, plain_scene

CONTROL = "control"


@dataclass(frozen=True, slots=True)
class Kind:
    """One thing that is done to the image, the scene or the parts.

    Attributes
    ----------
    make
        The scene of a seed; a function of a module or a `partial` of one, so that other processes can import it.
    """

    name: str
    make: Callable[[int, ImageFolder], RobustScene]


def rendered_kind(name: str, make: Callable[[str, int], RobustScene]) -> Kind:
    """A kind whose images take long to render and are kept on file."""
    return Kind(name, partial(_kept, name, make))


def _kept(name: str, make: Callable[[str, int], RobustScene], seed: int, images: ImageFolder) -> RobustScene:
    return images.scene(name, seed, make)


CONTROL_KIND = rendered_kind(CONTROL, plain_scene)

"""What a kind is: its name, and how it makes its scene of a seed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from benchmarks.robustness.scene import ImageFolder, RobustScene, plain_scene

CONTROL = "control"


@dataclass(frozen=True, slots=True)
class Kind:
    """One thing that is done to the image, the scene or the parts.

    Attributes
    ----------
    what
        What is done, in one sentence: the first line of the docstring of the function that does it.
    make
        The scene of a seed; a function of a module or a `partial` of one, so that other processes can import it.
    judges_only
        Held out: never run on the seeds on which parameters are fitted.
    """

    name: str
    what: str
    make: Callable[[int, ImageFolder], RobustScene]
    judges_only: bool = False


def rendered_kind(make: Callable[[str, int], RobustScene], name: str = "", what: str = "") -> Kind:
    """A kind whose images take long to render and are kept on file; named and described as its function is."""
    name = name or make.__name__
    return Kind(name, what or first_line(make), partial(_kept, name, make))


def held_out(kind: Kind) -> Kind:
    """The kind as one that judges and fits nothing."""
    return replace(kind, judges_only=True)


def first_line(of: Callable[..., object]) -> str:
    """What a function does."""
    return (of.__doc__ or "").split("\n", 1)[0]


def _kept(name: str, make: Callable[[str, int], RobustScene], seed: int, images: ImageFolder) -> RobustScene:
    return images.scene(name, seed, make)


CONTROL_KIND = rendered_kind(plain_scene, CONTROL)

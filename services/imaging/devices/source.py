"""The port through which images come in, whatever they come from."""

from contextlib import AbstractContextManager
from typing import Protocol


class Take(Protocol):
    """Takes the content of one image file and its sender's name. When it returns, the image is kept.

    Raises `ImageUnreadable` when it will never be taken, `Refused` or `OSError` when it cannot be taken now.
    """

    def __call__(self, content: bytes, sender: str, waited_s: float | None = 0.0, /) -> None:
        """Take an image that has waited at its source for at most `waited_s`; None when nobody knows for how long."""
        ...


class Refused(Exception):
    """Raised by whoever takes images when it cannot take one now."""


class ImageSource(Protocol):
    """Where images come from: a DICOM network, a folder, a camera.

    Every source logs why it refused an image, and goes on with the next one.
    """

    def receiving(self, take: Take) -> AbstractContextManager[str]:
        """Hand over images, from threads of its own, for as long as the context lasts.

        Yields what people should know of the source: where it listens, in which format.

        Raises
        ------
        ConfigurationError
            When it cannot start, with one sentence on what to do.
        """
        ...

"""When images were first received: an image that is offered again, or sent again, does not become younger."""

import threading
from collections import OrderedDict
from typing import Final

from services.imaging.devices.image_store import ImageStore
from shared.messages.imaging import FrameHeader

# Chosen: a bound on memory, above the images of the longest procedure.
_KEPT: Final = 1024


class Receipts:
    """First receipts of the images of this run of imaging, on its monotonic clock. Thread-safe.

    Parameters
    ----------
    store
        Nobody knows when an image that it has from an earlier run was received.
    """

    def __init__(self, store: ImageStore) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._first_s: OrderedDict[str, float | None] = OrderedDict()

    def note(self, sha256: str, at_s: float | None) -> None:
        """Note that an image is offered, before it is stored: the store may fail, and the image be offered again.

        Parameters
        ----------
        at_s
            When it was received; None when nobody knows.

        Raises
        ------
        OSError
            When the store cannot be asked whether it has the image from before; its age is then unknown.
        """
        with self._lock:
            if sha256 in self._first_s:
                return
            self._keep(sha256, None)
            if not self._store.has(sha256):
                self._keep(sha256, at_s)

    def with_age(self, header: FrameHeader, now_s: float) -> FrameHeader:
        """The header as it is published now."""
        with self._lock:
            first_s = self._first_s.get(header.sha256)
        return header.model_copy(update={"age_s": None if first_s is None else max(now_s - first_s, 0.0)})

    def _keep(self, name: str, at_s: float | None) -> None:
        self._first_s[name] = at_s
        while len(self._first_s) > _KEPT:
            self._first_s.popitem(last=False)

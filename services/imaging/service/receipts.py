"""When images were first received: an image that is offered again, or sent again, does not become younger.

An image is known by its file and by its SOP Instance UID (DICOM PS3.5, 9): with a patient's name corrected it is
another file, and the same exposure.
"""

import threading
from collections import OrderedDict
from typing import Final

from services.imaging.devices.image_store import ImageStore
from shared.messages.imaging import FrameHeader

# Chosen: a bound on memory, above the images of the longest procedure, of which each has two names.
_KEPT: Final = 2048


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

    def note(self, sha256: str, sop_instance_uid: str, at_s: float | None) -> bool:
        """Note that an image is offered, before it is stored: the store may fail, and the image be offered again.

        Returns whether another file came with its SOP Instance UID before, in this run of imaging.

        Parameters
        ----------
        at_s
            When it was received; None when nobody knows.

        Raises
        ------
        OSError
            When the store cannot be asked whether it has the image from before; its age is then unknown.
        """
        names = (sha256, sop_instance_uid)
        with self._lock:
            known = [self._first_s[name] for name in names if name in self._first_s]
            if known:
                is_other_file = sha256 not in self._first_s
                self._keep(names, _first(known))
                return is_other_file
            self._keep(names, None)
            if not self._store.has(sha256, sop_instance_uid):
                self._keep(names, at_s)
            return False

    def with_age(self, header: FrameHeader, now_s: float) -> FrameHeader:
        """The header as it is published now."""
        with self._lock:
            first_s = self._first_s.get(header.sha256)
        return header.model_copy(update={"age_s": None if first_s is None else max(now_s - first_s, 0.0)})

    def _keep(self, names: tuple[str, ...], at_s: float | None) -> None:
        self._first_s.update(dict.fromkeys(names, at_s))
        while len(self._first_s) > _KEPT:
            self._first_s.popitem(last=False)


def _first(receipts_s: list[float | None]) -> float | None:
    """The first of several receipts; None when nobody knows one of them."""
    known = [at_s for at_s in receipts_s if at_s is not None]
    return min(known) if len(known) == len(receipts_s) else None

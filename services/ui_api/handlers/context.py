"""Tells the other services which case is open, on the bus; the last word is kept for those who come later."""

import threading

from services.ui_api.core.case import Case
from services.ui_api.record.record import CaseRecord
from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.messages.base import encode
from shared.messages.cases import CaseContext, ObjectInside


class ContextHandler:
    """Publishes `CaseContext`. Whoever calls `announce` last has published the newest set-up, in whatever order."""

    def __init__(self, bus: Bus, keys: Keys, record: CaseRecord) -> None:
        self._record = record
        self._publisher = bus.retained_publisher(keys.case_context)
        self._lock = threading.Lock()

    def announce(self) -> None:
        """Publish the case that is open now, or that there is none."""
        with self._lock:
            case = self._record.ledger.open_case()
            inside = tuple(
                ObjectInside(kind=found.kind.value, hole_id=found.hole_id) for found in self._record.ledger.inside()
            )
            closed = CaseContext(case_id=None, revision=0, inside=inside)
            self._publisher.put(encode(closed if case is None else self._context(case, inside)))

    def _context(self, case: Case, inside: tuple[ObjectInside, ...]) -> CaseContext:
        setup = case.setup
        parts = {
            f"{name}_json": self._record.document(use.sha256).decode()
            for name, use in (
                ("ring", setup.ring),
                ("guide", setup.guide),
                ("nail", setup.nail),
                ("hexapod", setup.hexapod),
            )
        }
        return CaseContext.model_validate(
            {
                "case_id": case.case_id,
                "revision": case.revision,
                "side": setup.side,
                "bone": setup.bone,
                "mount": setup.mount,
                "head_extension_mm": setup.head_extension_mm,
                "nominal_source_to_detector_mm": setup.nominal_source_to_detector_mm,
                "nominal_pixel_mm": setup.nominal_pixel_mm,
                "drill_diameter_mm": setup.drill_diameter_mm,
                "inside": inside,
                **parts,
            }
        )

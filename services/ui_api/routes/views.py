"""What clients get: cases, images, localisations, verifications and events."""

import time

from pydantic import Field

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import ImageReceived, PartUse
from services.ui_api.core.events import Event
from services.ui_api.core.localising import operation_id_of
from services.ui_api.core.situation import Situation
from services.ui_api.record.codec import data_json
from services.ui_api.routes.base_view import View as View
from services.ui_api.routes.procedure_views import ProcedureView
from shared.messages.base import Identifier, Sha256, UnixNanoseconds
from shared.messages.imaging import FrameHeader


class PartView(View):
    """A part file in use."""

    name: str
    sha256: Sha256
    hole_ids: list[str]

    @staticmethod
    def of(use: PartUse) -> "PartView":
        """From the log's value."""
        return PartView(name=use.name, sha256=use.sha256, hole_ids=list(use.hole_ids))


class CaseView(View):
    """A case: its set-up and the state of its procedure."""

    id: str
    revision: int = Field(description="Counts up with every change of the set-up; older results are then stale.")
    opened_at_ns: UnixNanoseconds
    changed_at_ns: UnixNanoseconds
    side: str
    bone: str
    mount: str
    head_extension_mm: float
    ring: PartView
    guide: PartView
    nail: PartView
    hexapod: PartView
    guide_calibrated: bool
    hole_ids: list[str]
    nominal_source_to_detector_mm: float | None
    nominal_pixel_mm: float | None
    drill_diameter_mm: float
    images: int
    localisations: int
    plans: int
    verifications: int
    motions: list[str]
    procedure: ProcedureView

    @staticmethod
    def of(case: Case, situation: Situation) -> "CaseView":
        """From the ledger's value, and what may be done in it now."""
        setup = case.setup
        return CaseView(
            id=case.case_id,
            revision=case.revision,
            opened_at_ns=case.opened_at_ns,
            changed_at_ns=case.changed_at_ns,
            side=setup.side,
            bone=setup.bone,
            mount=setup.mount,
            head_extension_mm=setup.head_extension_mm,
            ring=PartView.of(setup.ring),
            guide=PartView.of(setup.guide),
            nail=PartView.of(setup.nail),
            hexapod=PartView.of(setup.hexapod),
            guide_calibrated=setup.guide_calibrated,
            hole_ids=list(case.hole_ids),
            nominal_source_to_detector_mm=setup.nominal_source_to_detector_mm,
            nominal_pixel_mm=setup.nominal_pixel_mm,
            drill_diameter_mm=setup.drill_diameter_mm,
            images=case.frames_let_go + len(case.images),
            localisations=len(case.localisations),
            plans=len(case.plans),
            verifications=len(case.verifications),
            motions=list(case.motions),
            procedure=ProcedureView.of(case, situation),
        )


class SkipView(View):
    """Why an image was not calibrated or not localised."""

    step: str
    code: str
    message: str


class ImageView(View):
    """An image of a case. `header` is null when the image itself was dropped on the bus but a result of it came."""

    id: Sha256
    case_id: Identifier
    case_revision: int
    sop_instance_uid: str
    received_at_ns: UnixNanoseconds
    header: FrameHeader | None
    localisation: int | None = Field(description="Number of the newest localisation made from it.")
    calibrated: bool | None = Field(description="Null until imaging has reported.")
    skipped: SkipView | None = Field(description="Why there is no calibration or no localisation and will be none.")
    operation: str | None = Field(
        description="Id of its way to the localisation (GET /operations/{id}); null of a frame that nobody localises."
    )
    age_s: float = Field(description="Time since it was received, as the gateway's clock has it; for people.")

    @staticmethod
    def of(case: Case, image: ImageReceived, header: FrameHeader | None) -> "ImageView":
        """From the ledger's value."""
        measured = case.localisation_of(image.image_sha256)
        calibration = case.calibration_of(image.image_sha256)
        skip = case.skip_of(image.image_sha256)
        return ImageView(
            id=image.image_sha256,
            case_id=case.case_id,
            case_revision=image.case_revision,
            sop_instance_uid=image.sop_instance_uid,
            received_at_ns=image.received_at_ns,
            header=header,
            localisation=None if measured is None else measured.number,
            calibrated=None if calibration is None else calibration.verdict == "accepted",
            skipped=None if skip is None else SkipView(step=skip.step, code=skip.code, message=skip.message),
            operation=operation_id_of(case, image),
            age_s=age_s(image.received_at_ns),
        )


class EventView(View):
    """One event of the log."""

    sequence: int
    at_ns: UnixNanoseconds
    case_id: str | None
    kind: str
    who: str
    why: str
    data: dict[str, object]

    @staticmethod
    def json_of(event: Event) -> str:
        """JSON text of an event, as it goes over the stream."""
        head = EventView(
            sequence=event.sequence,
            at_ns=event.at_ns,
            case_id=event.case_id,
            kind=event.kind,
            who=event.who,
            why=event.why,
            data={},
        ).model_dump_json(exclude={"data"})
        return f'{head[:-1]},"data":{data_json(event.data)}}}'


def age_s(received_at_ns: int) -> float:
    """Time since an image was received: wall clocks of hosts that keep the same time, for people only."""
    return max(0.0, (time.time_ns() - received_at_ns) / 1e9)

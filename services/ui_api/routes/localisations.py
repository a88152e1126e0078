"""`/cases/{id}/localisations`, `/cases/{id}/alignment`: what registration found, and how to turn the C-arm."""

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import LocalisationReceived
from services.ui_api.core.roles import Action
from services.ui_api.handlers.planning import localisation_of
from services.ui_api.handlers.procedure import localisation_staleness
from services.ui_api.handlers.refusals import conflict, unknown
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.guards import needs
from services.ui_api.routes.pages import Cursor, Limit, Page, Sort, VerdictFilter, page
from services.ui_api.routes.result_views import AlignmentView, GuidanceView, HoleTilt, LocalisationView
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.sparse import SPARSE
from services.ui_api.routes.views import age_s
from services.ui_api.service import Gateway
from shared.messages.base import decode
from shared.messages.drawing import ImageDrawing
from shared.messages.registration import LocalisationRecord

router = resource_router("/cases/{case_id}", tag="localisations")


@router.get("/localisations", dependencies=SPARSE, openapi_extra=needs(Action.READ))
def list_localisations(
    case_id: str,
    gateway: TheGateway,
    cursor: Cursor = None,
    limit: Limit = 50,
    verdict: VerdictFilter = None,
    sort: Sort = "oldest",
) -> Page[LocalisationView]:
    """The localisations of a case."""
    case = gateway.cases.case(case_id)

    def wanted(measured: LocalisationReceived) -> bool:
        return verdict in (None, measured.verdict)

    def view(measured: LocalisationReceived) -> LocalisationView:
        return _view(gateway, case, measured)

    return page(case.localisations, cursor, limit, view, wanted=wanted, sort=sort)


@router.get("/localisations/{number}", dependencies=SPARSE, openapi_extra=needs(Action.READ))
def read_localisation(case_id: str, number: int, gateway: TheGateway) -> LocalisationView:
    """What `locate` prints, plus provenance and whether it still holds."""
    case = gateway.cases.case(case_id)
    return _view(gateway, case, localisation_of(case, number))


@router.get("/localisations/{number}/drawing", openapi_extra=needs(Action.READ))
def read_drawing(case_id: str, number: int, gateway: TheGateway) -> ImageDrawing:
    """What was found as vectors, for viewers that draw it over the image: balls with residuals, nail, holes, drill."""
    case = gateway.cases.case(case_id)
    drawing = _document(gateway, localisation_of(case, number)).drawing
    if drawing is None:
        raise conflict("no_drawing", f"localisation {number} found no ring in its image, so nothing can be drawn on it")
    return drawing


@router.get("/alignment", openapi_extra=needs(Action.READ))
def read_alignment(case_id: str, gateway: TheGateway) -> AlignmentView:
    """How far and which way to turn the C-arm, from the newest localisation."""
    case = gateway.cases.case(case_id)
    measured = case.newest_localisation()
    if measured is None:
        raise unknown("localisation", "newest", f"case {case_id} has none yet; take an image")
    found = _document(gateway, measured)
    clause = localisation_staleness(case, measured)
    return AlignmentView(
        localisation=measured.number,
        image=measured.image_sha256,
        verdict=measured.verdict,
        reason_codes=list(measured.reason_codes),
        c_arm_correction_deg=found.localisation.c_arm_correction_deg,
        tilts=[HoleTilt(id=h.id, tilt_to_ray_deg=h.tilt_to_ray_deg) for h in found.localisation.holes or ()],
        assessment=found.assessment,
        off_centre_mm=found.off_centre_mm,
        age_s=age_s(found.image.received_at_ns),
        validity="current" if clause is None else "stale",
        stale_because=clause,
        guidance=_guidance(gateway, case),
    )


def _guidance(gateway: Gateway, case: Case) -> GuidanceView | None:
    heard = gateway.live.guidance(case.case_id)
    if heard is None:
        return None
    newest = case.images[-1].image_sha256 if case.images else None
    return GuidanceView.of(heard.guidance, gateway.live.heard_s_ago(heard), newest, case.revision)


def _document(gateway: Gateway, measured: LocalisationReceived) -> LocalisationRecord:
    return decode(LocalisationRecord, gateway.record.document(measured.document_sha256))


def _view(gateway: Gateway, case: Case, measured: LocalisationReceived) -> LocalisationView:
    return LocalisationView.of_record(case, measured, _document(gateway, measured))

"""`/parts`: the part files that the product ships, for choosing by name."""

from fastapi import Response
from pydantic import Field

from services.ui_api.core.roles import Action
from services.ui_api.handlers.refusals import unknown
from services.ui_api.routes.guards import needs
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.views import View
from shared.equipment import Bone
from shared.messages.base import Sha256
from shared.parts.canonical import canonical_part, catalogue_sha256
from shared.parts.catalogue import CatalogueEntry, PartKind, catalogue, catalogue_entry
from shared.parts.files import nail_from_json

router = resource_router("/parts", tag="parts")


class CatalogueView(View):
    """One part in the catalogue."""

    name: str
    kind: PartKind
    sha256: Sha256
    bone: Bone | None = Field(description="That a nail is made for; null of other parts.")

    @staticmethod
    def of(entry: CatalogueEntry) -> "CatalogueView":
        """From the catalogue."""
        bone = nail_from_json(entry.content, entry.name).bone if entry.kind == "nail" else None
        return CatalogueView(name=entry.name, kind=entry.kind, sha256=catalogue_sha256(entry), bone=bone)


@router.get("", openapi_extra=needs(Action.READ))
def list_parts() -> list[CatalogueView]:
    """The catalogue, by name."""
    return [CatalogueView.of(entry) for entry in catalogue()]


@router.get("/{name}", openapi_extra=needs(Action.READ))
def read_part(name: str) -> Response:
    """A part file, as a case keeps it: its SHA-256 is the part's hash."""
    entry = catalogue_entry(name)
    if entry is None:
        raise unknown("part", name, "GET /parts lists the catalogue")
    return Response(canonical_part(entry.content, name), media_type="application/json")

"""`/cases/{id}/images` and `/images/{id}`: images arrive from the C-arm by themselves and join the open case."""

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Response

from services.ui_api.core.event_data import ImageReceived
from services.ui_api.core.roles import Action
from services.ui_api.handlers.images import ImageHandler
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.guards import GuardedRoute, needs
from services.ui_api.routes.pages import Cursor, Limit, Page, page
from services.ui_api.routes.views import ImageView

router = APIRouter(route_class=GuardedRoute, tags=["images"])
ImageId = Annotated[str, Path(pattern=r"^[0-9a-f]{64}$", description="SHA-256 of the stored file.")]
PngView = Literal["raw", "corrected", "overlay"]


@router.get("/cases/{case_id}/images", openapi_extra=needs(Action.READ))
def list_images(case_id: str, gateway: TheGateway, cursor: Cursor = None, limit: Limit = 50) -> Page[ImageView]:
    """The images of a case, the oldest first; of running fluoroscopy the newest frames, and those that were measured.

    Older frames are among the case's events, and `GET /images/{id}` knows them.
    """
    case = gateway.cases.case(case_id)

    def view(image: ImageReceived) -> ImageView:
        return ImageView.of(case, image, gateway.images.header(image))

    return page(case.images, cursor, limit, view, case.frames_let_go)


@router.get(
    "/images/{image_id}.dcm",
    response_class=Response,
    responses={200: {"content": {"application/dicom": {}}}},
    openapi_extra=needs(Action.READ),
)
def read_dicom(image_id: ImageId, gateway: TheGateway) -> Response:
    """The file exactly as imaging stored it: its SHA-256 is the image's id."""
    return Response(gateway.images.dicom(image_id), media_type="application/dicom")


@router.get(
    "/images/{image_id}.png",
    response_class=Response,
    responses={200: {"content": {"image/png": {}}}},
    openapi_extra=needs(Action.READ),
)
def read_png(
    image_id: ImageId, gateway: TheGateway, view: Annotated[PngView, Query(description="What to draw.")] = "raw"
) -> Response:
    """The image for people: as received, without distortion, or with what was found drawn on it."""
    return Response(_draw(gateway.images, image_id, view), media_type="image/png")


@router.get("/images/{image_id}", openapi_extra=needs(Action.READ))
def read_image(image_id: ImageId, gateway: TheGateway) -> ImageView:
    """What is known of an image."""
    known = gateway.images.find(image_id)
    return ImageView.of(known.case, known.image, gateway.images.header(known.image))


def _draw(images: ImageHandler, image_id: str, view: PngView) -> bytes:
    match view:
        case "raw":
            return images.raw_png(image_id)
        case "corrected":
            return images.corrected_png(image_id)
        case "overlay":
            return images.overlay_png(image_id)

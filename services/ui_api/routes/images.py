"""`/cases/{id}/images` and `/images/{id}`: images arrive from the C-arm by themselves and join the open case."""

from collections.abc import Callable
from typing import Annotated, Literal

from fastapi import Path, Query, Request, Response

from services.ui_api.core.event_data import ImageReceived
from services.ui_api.core.picture import narrowed
from services.ui_api.core.roles import Action
from services.ui_api.handlers.images import ImageHandler
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.conditional import is_known
from services.ui_api.routes.guards import needs
from services.ui_api.routes.pages import Cursor, Limit, Page, Since, Sort, is_since, page
from services.ui_api.routes.preconditions import content_hash
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.sparse import SPARSE
from services.ui_api.routes.views import ImageView

router = resource_router(tag="images")
ImageId = Annotated[str, Path(pattern=r"^[0-9a-f]{64}$", description="SHA-256 of the stored file.")]
PngView = Literal["raw", "corrected", "overlay"]
Width = Annotated[
    int | None, Query(ge=16, le=4096, description="Width of the picture in pixels; it is made smaller, never larger.")
]


@router.get("/cases/{case_id}/images", dependencies=SPARSE, openapi_extra=needs(Action.READ))
def list_images(
    case_id: str,
    gateway: TheGateway,
    cursor: Cursor = None,
    limit: Limit = 50,
    since: Since = None,
    sort: Sort = "oldest",
) -> Page[ImageView]:
    """The images of a case; of running fluoroscopy the newest frames, and those that were measured.

    Older frames are among the case's events, and `GET /images/{id}` knows them.
    """
    case = gateway.cases.case(case_id)

    def view(image: ImageReceived) -> ImageView:
        return ImageView.of(case, image, gateway.images.header(image))

    def wanted(image: ImageReceived) -> bool:
        return is_since(image.received_at_ns, since)

    return page(case.images, cursor, limit, view, case.frames_let_go, wanted=wanted, sort=sort)


@router.get(
    "/images/{image_id}.dcm",
    response_class=Response,
    responses={200: {"content": {"application/dicom": {}}}},
    openapi_extra=needs(Action.READ),
)
def read_dicom(image_id: ImageId, request: Request, gateway: TheGateway) -> Response:
    """The file exactly as imaging stored it: its SHA-256 is the image's id, and its ETag."""
    gateway.images.find(image_id)
    return _kept(request, f'"{image_id}"', lambda: gateway.images.dicom(image_id), "application/dicom")


@router.get(
    "/images/{image_id}.png",
    response_class=Response,
    responses={200: {"content": {"image/png": {}}}},
    openapi_extra=needs(Action.READ),
)
def read_png(
    image_id: ImageId,
    request: Request,
    gateway: TheGateway,
    view: Annotated[PngView, Query(description="What to draw.")] = "raw",
    width: Width = None,
) -> Response:
    """The image for people: as received, without distortion (`?view=corrected`), or with what was found (`overlay`)."""
    images = gateway.images
    # Known before anything is drawn: what is drawn depends on these alone.
    etag = f'"{content_hash(repr((image_id, view, images.basis(image_id, view), width)).encode())}"'

    def draw() -> bytes:
        picture = _draw(images, image_id, view)
        return picture if width is None else narrowed(picture, width)

    return _kept(request, etag, draw, "image/png")


@router.get("/images/{image_id}", openapi_extra=needs(Action.READ))
def read_image(image_id: ImageId, gateway: TheGateway) -> ImageView:
    """What is known of an image."""
    known = gateway.images.find(image_id)
    return ImageView.of(known.case, known.image, gateway.images.header(known.image))


def _kept(request: Request, etag: str, content: Callable[[], bytes], media_type: str) -> Response:
    """What never changes under its ETag: a browser may keep it, and asks each time whether it may show it."""
    headers = {"etag": etag, "cache-control": "private, no-cache"}
    if is_known(request, etag):
        return Response(status_code=304, headers=headers)
    return Response(content(), headers=headers, media_type=media_type)


def _draw(images: ImageHandler, image_id: str, view: PngView) -> bytes:
    match view:
        case "raw":
            return images.raw_png(image_id)
        case "corrected":
            return images.corrected_png(image_id)
        case "overlay":
            return images.overlay_png(image_id)

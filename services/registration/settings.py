"""Settings of registration."""

from typing import Annotated, ClassVar

from pydantic import Field

from services.registration.core.acceptance.criteria import OLDEST_IMAGE
from shared.equipment import USUAL_WIRE_DIAMETER_MM
from shared.runtime.settings import ServiceSettings


class RegistrationSettings(ServiceSettings):
    """What registration is started with."""

    section: ClassVar[str] = "registration"

    kept_images: Annotated[int, Field(ge=2, le=64)] = Field(
        8, description="Newest localised images that are kept for plans and verifications."
    )
    image_delay_s: Annotated[float, Field(ge=0.0, le=30.0)] = Field(
        0.5,
        description="Longest time from an exposure until imaging has received it, and from imaging to registration, as "
        "measured on this C-arm; the time that an image waits in imaging is not part of it. An image that is received "
        "sooner than this after the robot moved may show it elsewhere, and no plan is made from it.",
    )
    oldest_image_s: Annotated[float, Field(gt=0.0, le=86400.0)] = Field(
        OLDEST_IMAGE.limit.value,
        description="Greatest age of an image from which a plan is made, in seconds since imaging received it, on "
        "monotonic clocks. An image shows where the bone was; what happens to the leg afterwards no one measures.",
    )
    frame_timeout_s: Annotated[float, Field(gt=0.0, le=60.0)] = Field(
        5.0, description="How long imaging may take to hand over the pixels of an image that was missed."
    )
    wire_diameter_mm: Annotated[float, Field(gt=0.0, le=6.0)] = Field(
        USUAL_WIRE_DIAMETER_MM, description="Diameter of the K-wires that are used through the guide."
    )
    live_check_every_s: Annotated[float, Field(gt=0.0, le=600.0)] = Field(
        5.0, description="How often a frame of a running fluoroscopy is localised in full to check the guidance."
    )

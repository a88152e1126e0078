"""Settings of imaging."""

from typing import Annotated, ClassVar

from pydantic import Field

from shared.runtime.settings import ServiceSettings

Port = Annotated[int, Field(ge=0, le=65535)]
AeTitle = Annotated[str, Field(min_length=1, max_length=16, pattern=r"^[A-Za-z0-9_.-]+$")]


class ImagingSettings(ServiceSettings):
    """What imaging is started with."""

    section: ClassVar[str] = "imaging"

    dicom_host: str = Field("0.0.0.0", description="Interface on which images are received.")  # noqa: S104
    dicom_port: Port = Field(11112, description="TCP port of DICOM reception.")
    dicom_ae_title: AeTitle = Field("DISTALOCK", description="Application entity title that the C-arm must call.")
    default_source_to_detector_mm: Annotated[float, Field(gt=100.0, lt=3000.0)] = Field(
        1000.0, description="Used when neither the case nor the image says."
    )
    default_pixel_mm: Annotated[float, Field(gt=0.01, lt=2.0)] = Field(
        0.235, description="Pixel size at the detector; used when neither the case nor the image says."
    )

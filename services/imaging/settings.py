"""Settings of imaging."""

from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field

from shared.bus.tls import TlsFiles
from shared.runtime.settings import ServiceSettings

NotNegative = Annotated[int, Field(ge=0, le=16384)]
Side = Annotated[int, Field(ge=16, le=16384)]
Port = Annotated[int, Field(ge=0, le=65535)]
AeTitle = Annotated[str, Field(min_length=1, max_length=16, pattern=r"^[A-Za-z0-9_.-]+$")]
CommonName = Annotated[str, Field(min_length=1, max_length=64)]


class ImagingSettings(ServiceSettings):
    """What imaging is started with."""

    section: ClassVar[str] = "imaging"

    dicom_host: str = Field(
        "127.0.0.1", description="Interface on which images are received; 0.0.0.0 for all, when the C-arm is elsewhere."
    )
    dicom_port: Port = Field(11112, description="TCP port of DICOM reception.")
    dicom_ae_title: AeTitle = Field("DISTALOCK", description="Application entity title that the C-arm must call.")
    dicom_calling_ae_titles: tuple[AeTitle, ...] = Field((), description="Titles that may send; anyone when empty.")
    dicom_tls: bool = Field(
        default=False,
        description="DICOM under TLS (PS3.15 B.12), with senders that prove who they are by a certificate.",
    )
    dicom_tls_authority: Path | None = Field(
        None,
        description="Certificate of the authority of senders; default: pki/network/dicom in state_dir, as those below.",
    )
    dicom_tls_certificate: Path | None = Field(None, description="Certificate of the receiver.")
    dicom_tls_key: Path | None = Field(None, description="Private key of the receiver.")
    dicom_tls_senders: tuple[CommonName, ...] = Field(
        (), description="Common names of certificates that may send; everybody whom the authority signed when empty."
    )
    dicom_most_associations: Annotated[int, Field(ge=1, le=100)] = Field(10, description="Open at the same time.")
    watched_folder: Path | None = Field(None, description="Folder whose image files are taken as they appear.")
    video: str = Field(
        "", description="Part of a device's name in /dev/v4l/by-id, a device, a file, or an rtsp, udp, tcp or http URL."
    )
    video_region: tuple[NotNegative, NotNegative, Side, Side] | None = Field(
        None,
        description="Left, top, width and height of the X-ray image within a frame, in pixels; the whole if not set.",
    )
    video_frames: Annotated[int, Field(ge=1, le=256)] = Field(8, description="Still frames that are averaged.")
    run_interval_s: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        0.5,
        description="Longest time between two images of a run (running fluoroscopy). An image of a run is followed for "
        "guidance; of a run only the newest image is localised in full when that is due. 0: every image is a single "
        "shot.",
    )
    default_source_to_detector_mm: Annotated[float, Field(gt=100.0, lt=3000.0)] = Field(
        1000.0, description="Used when neither the case nor the image says."
    )
    default_pixel_mm: Annotated[float, Field(gt=0.01, lt=2.0)] = Field(
        0.235, description="Pixel size at the detector; used when neither the case nor the image says."
    )
    images_inverted: bool = Field(
        default=False,
        description="Metal is bright in the images received, although their files state the opposite or nothing.",
    )

    def dicom_tls_files(self) -> TlsFiles:
        """Key and certificate of the receiver, and whose senders it believes."""
        made = TlsFiles.in_network(self.state_dir, "dicom")
        return TlsFiles(
            self.dicom_tls_authority or made.authority,
            self.dicom_tls_certificate or made.certificate,
            self.dicom_tls_key or made.key,
        )

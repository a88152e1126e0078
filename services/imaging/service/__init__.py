"""The service itself: what imaging does with images and questions that reach it."""

from services.imaging.service.calibrator import Calibrator
from services.imaging.service.headers import Defaults
from services.imaging.service.imaging_service import ImagingService

__all__ = ["Calibrator", "Defaults", "ImagingService"]

"""The service itself: what imaging does with images and questions that reach it."""

from services.imaging.service.imaging_service import Defaults, ImagingService

__all__ = ["Defaults", "ImagingService"]

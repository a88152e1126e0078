"""Whether there is room for one more case: a procedure that has begun must not lose an image to a full disk."""

from pathlib import Path

from services.ui_api.handlers.service_health import ServiceHealth
from shared.runtime.impairments import DISK, lack_of_space
from shared.runtime.settings import ServiceSettings


class DiskSpace:
    """Looks at the disks of record and images here, and at what imaging says of its own, which may be elsewhere."""

    def __init__(self, settings: ServiceSettings, image_dir: Path, services: ServiceHealth) -> None:
        self._settings = settings
        self._folders = (settings.state_dir, image_dir)
        self._services = services

    def lack(self) -> str | None:
        """A sentence with what was measured, the limit and the remedy; None while there is room."""
        here = (lack_of_space(folder, self._settings) for folder in self._folders)
        return next((sentence for sentence in here if sentence is not None), self._lack_at_imaging())

    def _lack_at_imaging(self) -> str | None:
        status = self._services.heard["imaging"].status
        return f"imaging reports: {status.detail}" if status is not None and DISK in status.impaired else None

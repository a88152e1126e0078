"""The settings of all services, as this process would read them."""

from typing import Final

from services.imaging.settings import ImagingSettings
from services.registration.settings import RegistrationSettings
from services.robot.settings import RobotSettings
from services.ui_api.settings import UiApiSettings
from shared.doctor.finding import Finding, well, wrong
from shared.errors import ConfigurationError
from shared.runtime.settings import ServiceSettings, load_settings

_SETTINGS: Final[tuple[type[ServiceSettings], ...]] = (
    ImagingSettings,
    RegistrationSettings,
    RobotSettings,
    UiApiSettings,
)


def settings_finding() -> Finding:
    """Whether every service could read its settings."""
    for kind in _SETTINGS:
        try:
            load_settings(kind)
        except ConfigurationError as error:
            return wrong(
                "settings", f"{kind.section}: {error}", "correct the variable, or the file of DISTALOCK_CONFIG"
            )
    return well("settings", "all services can read theirs")

"""Settings of access control. Pure."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from services.ui_api.core.networks import Network

DEMO_USER: Final = "demo"
# Beside the record: the path of the one-time link for the first account, while there is none.
SETUP_FILE: Final = "set-up-link"


@dataclass(frozen=True, slots=True)
class AccessSettings:
    """Settings of access control.

    Attributes
    ----------
    demo_token
        Token and password of the user `demo`, in a simulation; None where there is no such user.
    """

    state_dir: Path
    room_networks: tuple[Network, ...]
    demo_token: str | None

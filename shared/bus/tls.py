"""The files with which one program proves on the bus who it is: a key, its certificate, and the authority it trusts."""

import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from shared.errors import ConfigurationError

AUTHORITY_FILE: Final = "authority.pem"
CERTIFICATE_FILE: Final = "certificate.pem"
KEY_FILE: Final = "key.pem"
SCHEME: Final = "tls/"
PKI_FOLDER: Final = "pki"
NETWORK_FOLDER: Final = "network"
PLAIN_BUS_WARNING: Final = (
    "the bus runs without TLS and access control: whoever reaches its port may speak as any service"
)
_READABLE_BY_OTHERS: Final = stat.S_IRWXG | stat.S_IRWXO


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """Where they lie.

    Attributes
    ----------
    authority
        Certificate of the authority: who it has signed is believed, and nobody else.
    certificate, key
        Certificate of this program, and its private key.
    """

    authority: Path
    certificate: Path
    key: Path

    @classmethod
    def in_folder(cls, folder: Path) -> Self:
        """The three files of one folder, as `distalock pki` writes them."""
        return cls(folder / AUTHORITY_FILE, folder / CERTIFICATE_FILE, folder / KEY_FILE)

    @classmethod
    def in_state(cls, state_dir: Path, name: str) -> Self:
        """The files of one service (or of the router) in the state folder of an installation."""
        return cls.in_folder(state_dir / PKI_FOLDER / name)

    @classmethod
    def in_network(cls, state_dir: Path, name: str) -> Self:
        """The files of what faces the hospital's network, which has an authority of its own."""
        return cls.in_folder(state_dir / PKI_FOLDER / NETWORK_FOLDER / name)

    def require(self) -> None:
        """Refuse files that are missing, or a key that others can read; raises `ConfigurationError`."""
        _require_file(self.authority)
        self.require_own()

    def require_own(self) -> None:
        """The same for a program that trusts nobody, such as a server that lets in everybody."""
        _require_file(self.certificate)
        _require_file(self.key)
        require_private(self.key)


def _require_file(file: Path) -> None:
    if not file.is_file():
        raise ConfigurationError(
            f"{file} is missing: without it nobody is let on the bus; make it (distalock pki init), or name "
            "the files with DISTALOCK_TLS_AUTHORITY, DISTALOCK_TLS_CERTIFICATE and DISTALOCK_TLS_KEY"
            if NETWORK_FOLDER not in file.parts
            else f"{file} is missing: without it there is no TLS; make it (distalock pki init)"
        )


def require_private(key: Path) -> None:
    """Refuse a private key that anybody but its owner can read; raises `ConfigurationError`."""
    mode = stat.S_IMODE(key.stat().st_mode)
    if mode & _READABLE_BY_OTHERS:
        raise ConfigurationError(
            f"{key} can be read by others (mode {mode:04o}, 0600 is needed); if nobody has, chmod 600 it, otherwise "
            "make all keys anew (distalock pki rotate)"
        )

"""Where keys and certificates lie, and when they are made anew.

::

    pki/authority/{authority.pem, key.pem}                what `distalock pki` signs with; no service reads it
    pki/SERVICE/{authority.pem, certificate.pem, key.pem}  all that one service needs
    pki/ui_api/permit_key.pem                             what the gateway signs permits to move with
    pki/robot/permit_certificate.pem                      by which the robot knows those permits

Folders can be entered and keys be read by their owner only. Each service has a folder of its own, so that a container
gets that one and no other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from enum import StrEnum
from pathlib import Path
from typing import Final, get_args

from shared.bus.access import EXPORTER
from shared.bus.tls import AUTHORITY_FILE, KEY_FILE, TlsFiles, require_private
from shared.errors import ConfigurationError
from shared.messages.presence import ServiceName
from shared.pki.authority import (
    CERTIFICATE_VALID,
    CertificateFacts,
    Identity,
    Use,
    belong_together,
    is_issued_by,
    issue,
    new_authority,
)
from shared.pki.permit_key import PERMIT_CERTIFICATE_FILE, PERMIT_KEY_FILE
from shared.pki.private_files import private_folder, read_file, write_private

ROUTER: Final = "router"
PERMIT: Final = "permit"
# Who has a folder, and whose certificates there are.
NAMES: Final[tuple[str, ...]] = (ROUTER, *get_args(ServiceName), EXPORTER)
ISSUED: Final[tuple[str, ...]] = (*NAMES, PERMIT)
# Half of their validity: whoever starts an installation once in half a year never sees one expire.
RENEW_BEFORE: Final = timedelta(days=180)
HERE: Final = ("localhost", "127.0.0.1", "::1")
AUTHORITY: Final = "authority"


@dataclass(frozen=True, slots=True)
class Holder:
    """Somebody with a certificate.

    Attributes
    ----------
    host_names
        Names and addresses under which a server is reached, unless its certificate states more already.
    """

    use: Use
    host_names: tuple[str, ...] = ()


# Who meets on the bus. What faces the hospital's network has an authority of its own: `network`.
BUS: Final[Mapping[str, Holder]] = {
    ROUTER: Holder(Use.SERVER, (*HERE, ROUTER)),
    **{name: Holder(Use.CLIENT) for name in get_args(ServiceName)},
    EXPORTER: Holder(Use.CLIENT),
    PERMIT: Holder(Use.PERMIT),
}


class Standing(StrEnum):
    """What becomes of a certificate when the installation starts the next time."""

    VALID = "valid"
    RENEWAL_DUE = "renewal due"
    EXPIRED = "expired"
    OTHER_AUTHORITY = "of another authority"
    OTHER_KEY = "of another key"
    MISSING = "missing"


@dataclass(frozen=True, slots=True)
class Entry:
    """One certificate of the folder; `facts` is None where there is none."""

    name: str
    standing: Standing
    facts: CertificateFacts | None


class Keystore:
    """The folder of an installation's keys and certificates.

    Parameters
    ----------
    folder
        Made with the first authority.
    holders
        Whose certificates the authority signs.
    """

    def __init__(self, folder: Path, holders: Mapping[str, Holder] = BUS) -> None:
        self.folder, self.holders = folder, holders

    def folder_of(self, name: str) -> Path:
        """Folder of what one service (or the router) needs."""
        return self.folder / name

    def ensure(self, now: datetime, host_names: Sequence[str] = ()) -> tuple[str, ...]:
        """Make what is missing and renew what is due.

        Parameters
        ----------
        host_names
            Further names of the servers' host. The names that a certificate has stay.

        Returns
        -------
        tuple of str
            Whose certificates are new.

        Raises
        ------
        ConfigurationError
            When the folder cannot be read or written, or others can read a key.
        """
        if self._authority_is_due(now):
            return self.rotate(now, host_names)
        due = [entry.name for entry in self.entries(now) if entry.standing is not Standing.VALID]
        unnamed = {name for name in self._servers() if set(host_names) - set(self._host_names(name))}
        return self.issue([name for name in self.holders if name in unnamed.union(due)], now, host_names)

    def issue(self, names: Sequence[str], now: datetime, host_names: Sequence[str] = ()) -> tuple[str, ...]:
        """Make new keys and certificates for some, from the authority that there is; see `ensure`."""
        if not names:
            return ()
        if unknown := sorted(set(names) - self.holders.keys()):
            raise ConfigurationError(f"nobody is called '{unknown[0]}' here; known are {', '.join(self.holders)}")
        authority = self._authority()
        for name in names:
            known_as = (*self._host_names(name), *host_names) if name in self._servers() else ()
            identity = issue(authority, name, self.holders[name].use, tuple(dict.fromkeys(known_as)), now)
            self._write(name, identity, authority.certificate_pem)
        return tuple(names)

    def rotate(self, now: datetime, host_names: Sequence[str] = ()) -> tuple[str, ...]:
        """Make a new authority and all certificates: none of before is accepted any more; see `ensure`."""
        authority = new_authority(now)
        folder = private_folder(self.folder / AUTHORITY)
        write_private(folder / KEY_FILE, authority.key_pem)
        write_private(folder / AUTHORITY_FILE, authority.certificate_pem)
        return self.issue(tuple(self.holders), now, host_names)

    def entries(self, now: datetime) -> tuple[Entry, ...]:
        """How the certificates stand, those of the bus with the router's first."""
        return tuple(self._entry(name, now) for name in self.holders)

    def authority_facts(self) -> CertificateFacts:
        """What the authority's certificate says; raises `ConfigurationError` when there is none."""
        return CertificateFacts.of(self._authority_certificate())

    def _authority_is_due(self, now: datetime) -> bool:
        if not (self.folder / AUTHORITY / AUTHORITY_FILE).exists():
            return True
        # What it issues now must not end before its time.
        return self.authority_facts().not_after < now + CERTIFICATE_VALID

    def _entry(self, name: str, now: datetime) -> Entry:
        files = self._files(name)
        if not all(file.exists() for file in (files.authority, files.certificate, files.key)):
            return Entry(name, Standing.MISSING, None)
        require_private(files.key)
        identity = Identity(read_file(files.key), read_file(files.certificate))
        facts = CertificateFacts.of(identity.certificate_pem)
        return Entry(name, self._standing(identity, facts, read_file(files.authority), now), facts)

    def _files(self, name: str) -> TlsFiles:
        """Where the key and the certificate of a name lie: of permits, the gateway signs and the robot verifies."""
        if name != PERMIT:
            return TlsFiles.in_folder(self.folder_of(name))
        robot, gateway = self.folder_of("robot"), self.folder_of("ui_api")
        return TlsFiles(robot / AUTHORITY_FILE, robot / PERMIT_CERTIFICATE_FILE, gateway / PERMIT_KEY_FILE)

    def _standing(self, identity: Identity, facts: CertificateFacts, trusted: bytes, now: datetime) -> Standing:
        authority = self._authority_certificate()
        if trusted != authority or not is_issued_by(authority, identity.certificate_pem):
            return Standing.OTHER_AUTHORITY
        if not belong_together(identity):
            return Standing.OTHER_KEY
        if not facts.not_before <= now <= facts.not_after:
            return Standing.EXPIRED
        return Standing.RENEWAL_DUE if facts.not_after - now < RENEW_BEFORE else Standing.VALID

    def _servers(self) -> tuple[str, ...]:
        return tuple(name for name, holder in self.holders.items() if holder.use is Use.SERVER)

    def _host_names(self, name: str) -> tuple[str, ...]:
        """Under which names a server is reached: those that its certificate states, when it has one."""
        file = self._files(name).certificate
        return CertificateFacts.of(read_file(file)).host_names if file.exists() else self.holders[name].host_names

    def _authority(self) -> Identity:
        key = self.folder / AUTHORITY / KEY_FILE
        if not key.exists():
            raise ConfigurationError(
                f"{key} is missing, so no certificate can be made; put it back, or make a new authority "
                "(distalock pki rotate)"
            )
        require_private(key)
        authority = Identity(read_file(key), self._authority_certificate())
        if not belong_together(authority):
            raise ConfigurationError(
                f"{key} is not the key of the authority's certificate; make a new authority (distalock pki rotate)"
            )
        return authority

    def _authority_certificate(self) -> bytes:
        file = self.folder / AUTHORITY / AUTHORITY_FILE
        if not file.exists():
            raise ConfigurationError(f"there is no authority in {self.folder}; make one (distalock pki init)")
        return read_file(file)

    def _write(self, name: str, identity: Identity, authority_pem: bytes) -> None:
        files = self._files(name)
        for file, content in (
            (files.key, identity.key_pem),
            (files.certificate, identity.certificate_pem),
            (files.authority, authority_pem),
        ):
            private_folder(file.parent)
            write_private(file, content)

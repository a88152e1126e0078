"""Attacks on the links: who gets one at the router, and whom a service takes for the router."""

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import zenoh

from shared.bus.access import CLIENTS
from shared.bus.settings import BusSettings
from shared.bus.tls import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, TlsFiles
from shared.bus.zenoh_bus import client_config
from shared.errors import BusUnavailable
from shared.pki.authority import CERTIFICATE_VALID, Identity, Use, issue, new_authority
from shared.pki.keystore import ROUTER, Keystore
from tests.attacks.attack import Attack, Record
from tests.attacks.peers import NOTHING_PASSES, listen_to_all, overheard_or_forged, peer_past_the_router, router_with
from tests.attacks.site import Site

NO_LINK: Final = "no link"
Forgery = Callable[[Identity], Identity]
_NOW: Final = datetime.now(UTC)
_LONG_AGO: Final = _NOW - CERTIFICATE_VALID - timedelta(days=1)


def _authority(keystore: Keystore) -> Identity:
    folder = keystore.folder_of("authority")
    return Identity((folder / KEY_FILE).read_bytes(), (folder / AUTHORITY_FILE).read_bytes())


def _written(folder: Path, identity: Identity, trusted: bytes) -> TlsFiles:
    """The files of an identity that trusts an authority."""
    folder.mkdir(exist_ok=True)
    for name, content in (
        (KEY_FILE, identity.key_pem),
        (CERTIFICATE_FILE, identity.certificate_pem),
        (AUTHORITY_FILE, trusted),
    ):
        (folder / name).write_bytes(content)
        (folder / name).chmod(0o600)
    return TlsFiles.in_folder(folder)


def _link_with(site: Site, files: TlsFiles | None, endpoint: str = "") -> str:
    try:
        with site.open_with(files, endpoint):
            return "a link was made"
    except BusUnavailable:
        return NO_LINK


def _forged(forge: Forgery) -> Callable[[Site], str]:
    def run(site: Site) -> str:
        authority = _authority(site.keystore)
        files = _written(site.scratch / "forged", forge(authority), authority.certificate_pem)
        return _link_with(site, files)

    return run


def _without_certificate(site: Site) -> str:
    config = client_config(BusSettings(site.endpoint))
    config.insert_json5("transport/link/tls/root_ca_certificate", json.dumps(str(site.files_of("robot").authority)))
    try:
        with zenoh.open(config):
            return "a link was made"
    except zenoh.ZError:
        return NO_LINK


def _anothers_certificate(site: Site) -> str:
    """What is public of the robot, with a key of somebody else."""
    robot = site.files_of("robot")
    mixed = Identity(site.files_of("imaging").key.read_bytes(), robot.certificate.read_bytes())
    return _link_with(site, _written(site.scratch / "mixed", mixed, robot.authority.read_bytes()))


def _unknown_name(site: Site) -> str:
    authority = _authority(site.keystore)
    identity = issue(authority, "stranger", Use.CLIENT, (), _NOW)
    files = _written(site.scratch / "stranger", identity, authority.certificate_pem)
    with site.open_with(files) as stranger:
        return overheard_or_forged(site, stranger._session)


def _revoked(site: Site) -> str:
    """The keys of before a rotation, at a router with those of after it."""
    old = _written_copy(site, "robot")
    rotated = Keystore(site.scratch / "rotated")
    rotated.rotate(datetime.now(UTC))
    with router_with(TlsFiles.in_folder(rotated.folder_of(ROUTER))) as endpoint:
        trusting = TlsFiles(rotated.folder_of("robot") / AUTHORITY_FILE, old.certificate, old.key)
        refused = _link_with(site, trusting, endpoint)
        renewed = _link_with(site, TlsFiles.in_folder(rotated.folder_of("robot")), endpoint)
    return refused if renewed != NO_LINK else "the new key was refused, too"


def _written_copy(site: Site, name: str) -> TlsFiles:
    files = site.files_of(name)
    identity = Identity(files.key.read_bytes(), files.certificate.read_bytes())
    return _written(site.scratch / f"old-{name}", identity, files.authority.read_bytes())


def _impostor(site: Site) -> str:
    """Each service's key plays the router; the robot's session must believe none."""
    for name in CLIENTS:
        with router_with(site.files_of(name)) as endpoint:
            if (seen := _link_with(site, site.files_of("robot"), endpoint)) != NO_LINK:
                return f"{name}: {seen}"
    return NO_LINK


def _by_router(text: str) -> Record:
    """What the router refused and reported, in the case record."""
    return Record("case-record", f"bus_refused.*{text}")


_AUTHORITYS_KEY: Final = "the authority's key"

ATTACKS: Final = (
    Attack(
        "no certificate",
        "nothing",
        "link to the router with TLS, without a certificate",
        NO_LINK,
        _by_router("peer sent no certificates"),
        _without_certificate,
    ),
    Attack(
        "plain TCP",
        "nothing",
        "link to the router without TLS",
        NO_LINK,
        _by_router("InvalidContentType"),
        lambda site: _link_with(site, None, site.endpoint.replace("tls/", "tcp/")),
    ),
    Attack(
        "self-signed",
        "nothing",
        "a certificate that signs itself",
        NO_LINK,
        _by_router("CaUsedAsEndEntity"),
        _forged(lambda _: new_authority(_NOW)),
    ),
    Attack(
        "of another authority",
        "an authority of their own",
        "a certificate for `robot` from it",
        NO_LINK,
        _by_router("UnknownIssuer"),
        _forged(lambda _: issue(new_authority(_NOW), "robot", Use.CLIENT, (), _NOW)),
    ),
    Attack(
        "expired",
        "an old key of the robot",
        "its certificate, which has ended",
        NO_LINK,
        _by_router("certificate expired"),
        _forged(lambda authority: issue(authority, "robot", Use.CLIENT, (), _LONG_AGO)),
    ),
    Attack(
        "not valid yet",
        "a key of the robot",
        "its certificate, which begins in two days",
        NO_LINK,
        _by_router("not valid yet"),
        _forged(lambda authority: issue(authority, "robot", Use.CLIENT, (), _NOW + timedelta(days=2))),
    ),
    Attack(
        "server as client",
        "a certificate that the authority signed for a server",
        "link as a service",
        NO_LINK,
        _by_router("extended key usage"),
        _forged(lambda authority: issue(authority, "robot", Use.SERVER, ("localhost",), _NOW)),
    ),
    Attack(
        "another's certificate",
        "imaging's key, the robot's public certificate",
        "link as the robot",
        NO_LINK,
        None,
        _anothers_certificate,
    ),
    Attack("revoked", "the robot's key of before `distalock pki rotate`", "link after it", NO_LINK, None, _revoked),
    Attack(
        "unknown name",
        _AUTHORITYS_KEY,
        "link as `stranger`; listen to all, speak as the robot",
        NOTHING_PASSES,
        _by_router("stranger"),
        _unknown_name,
    ),
    Attack("service as router", "each service's key", "play the router for the robot", NO_LINK, None, _impostor),
    Attack(
        "peer past the router",
        "imaging's key",
        "listen and invite everybody; speak as the robot",
        NOTHING_PASSES,
        _by_router("robot/state.*imaging"),
        peer_past_the_router,
    ),
    Attack(
        "listen to everything",
        "imaging's key",
        "subscribe to `**`; speak as the robot",
        NOTHING_PASSES,
        _by_router(r"\*\*.*imaging"),
        listen_to_all,
    ),
)

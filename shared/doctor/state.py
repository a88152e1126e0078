"""The state folder: certificates and approved parts."""

from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Final

from shared.bus.tls import PKI_FOLDER
from shared.doctor.finding import Finding, attention, unknown, well, wrong
from shared.errors import ConfigurationError
from shared.parts.approvals import PartApprovals
from shared.pki.keystore import Keystore, Standing
from shared.pki.network import network_keystore

_RENEWED_AT_START: Final = frozenset((Standing.RENEWAL_DUE, Standing.EXPIRED, Standing.MISSING))


def state_findings(state_dir: Path, now: datetime) -> Iterator[Finding]:
    """Certificates and approvals of an installation that was started before; one finding where there is none."""
    if not (state_dir / PKI_FOLDER).is_dir():
        yield unknown("certificates", f"no installation was started in {state_dir}", "`distalock up` makes them")
    else:
        for name, keystore in (("bus", Keystore), ("network", network_keystore)):
            yield certificates_finding(f"certificates ({name})", keystore(state_dir / PKI_FOLDER), now)
    yield approvals_finding(state_dir)


def certificates_finding(name: str, keystore: Keystore, now: datetime) -> Finding:
    """Of all that one authority has issued."""
    return _readable(name, lambda: _standing(name, keystore, now))


def _standing(name: str, keystore: Keystore, now: datetime) -> Finding:
    entries = keystore.entries(now)
    bad = [entry for entry in entries if entry.standing is not Standing.VALID]
    authority = keystore.authority_facts()
    if authority.not_after <= now:
        return wrong(name, f"the authority ended on {authority.not_after:%Y-%m-%d}", "`distalock pki rotate`")
    if not bad:
        first = min((entry.facts.not_after for entry in entries if entry.facts is not None), default=now)
        return well(name, f"{len(entries)} valid, the first ends on {first:%Y-%m-%d}")
    named = ", ".join(f"{entry.name}: {entry.standing}" for entry in bad)
    if all(entry.standing in _RENEWED_AT_START for entry in bad):
        return attention(name, named, "`distalock up` renews them at its next start; containers: `pki init`")
    return wrong(name, named, f"`distalock pki issue {' '.join(entry.name for entry in bad)}`")


def approvals_finding(state_dir: Path) -> Finding:
    """Which part files may be used."""

    def counted() -> Finding:
        approvals = PartApprovals(state_dir).all()
        return well("parts", f"the catalogue, and {len(approvals)} approved part files")

    return _readable("parts", counted)


def _readable(name: str, look: Callable[[], Finding]) -> Finding:
    try:
        return look()
    except ConfigurationError as error:
        return wrong(name, str(error), "restore the state folder from a backup, or see who changed it")

"""What `distalock doctor` finds, as far as it can be seen from the gateway: its machine, its folder, what runs."""

from collections.abc import Iterator
from concurrent.futures import wait
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from services.ui_api.handlers.readiness import PROBE_WITHIN_S, Readiness
from shared.bus.tls import NETWORK_FOLDER, PKI_FOLDER
from shared.doctor.finding import Finding, of_running, unknown
from shared.doctor.machine import Machine, disk_finding, machine_findings
from shared.doctor.state import approvals_finding, certificates_finding
from shared.pki.keystore import AUTHORITY, Keystore
from shared.pki.network import network_keystore
from shared.runtime.settings import ServiceSettings

_ELSEWHERE: Final = "their authority is not in this machine's state folder"
_SEEN_ELSEWHERE: Final = "`distalock pki show` where they are made"


class Diagnosis:
    """Looks, changes nothing; takes as long as a probe of disk and database, so that no event loop may wait for it.

    Attributes
    ----------
    state_dir
        The folder that is looked at.
    """

    def __init__(self, settings: ServiceSettings, readiness: Readiness) -> None:
        self._settings, self._readiness = settings, readiness
        self.state_dir = settings.state_dir

    def findings(self) -> tuple[Finding, ...]:
        """Everything that is seen from here, in the order of `distalock doctor`."""
        folder = self.state_dir
        return (
            *machine_findings(Machine.read(folder)),
            disk_finding(folder, self._settings),
            *_certificates(folder / PKI_FOLDER),
            approvals_finding(folder),
            *self._running(),
        )

    def _running(self) -> Iterator[Finding]:
        probe = self._readiness.probe()
        wait((probe,), PROBE_WITHIN_S)
        for check in self._readiness.checks(probe):
            yield of_running(check.name, check.measured, check.remedy, does_its_work=check.ok)


def _certificates(folder: Path) -> Iterator[Finding]:
    """Of all where their authority is; a machine that has its own certificates alone can judge none."""
    now = datetime.now(UTC)
    for name, place, keystore in (("bus", folder, Keystore), ("network", folder / NETWORK_FOLDER, network_keystore)):
        if (place / AUTHORITY).is_dir():
            yield certificates_finding(f"certificates ({name})", keystore(folder), now)
        else:
            yield unknown(f"certificates ({name})", _ELSEWHERE, _SEEN_ELSEWHERE)

"""The processes of a whole installation on one machine: router, services and, if wanted, the virtual operating room."""

import json
import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from distalock.arguments import PORTS
from distalock.demo_user import TOKEN_FILE, demo_token
from distalock.local_ports import free_ports, require_free_port, tcp_port_answers
from distalock.processes import Fleet, ProcessSpec
from distalock.readiness import GatewayReady, Server
from shared.bus.access import EXPORTER
from shared.bus.tls import PKI_FOLDER, TlsFiles
from shared.pki.keystore import ROUTER, Keystore
from shared.pki.network import REST, network_keystore
from shared.runtime.settings import ServiceSettings, load_settings

_LOOPBACK = "127.0.0.1"
_DICOM_HOST = "DISTALOCK_IMAGING_DICOM_HOST"
_REST_HOST = "DISTALOCK_UI_API_HOST"
_UNAPPROVED_PARTS = "DISTALOCK_UI_API_UNAPPROVED_PARTS"
DEMO_TOKEN: Final = "DISTALOCK_UI_API_DEMO_TOKEN_FILE"  # noqa: S105 - a variable's name
_VIRTUAL_ROOM = "DISTALOCK_UI_API_VIRTUAL_ROOM_URL"
_OWN_CERTIFICATE = "DISTALOCK_UI_API_HTTPS_CERTIFICATE"
# Addresses to listen on that mean every address of this machine; none to call.
_EVERY_ADDRESS = ("0.0.0.0", "::")  # noqa: S104 - not bound here


@dataclass(frozen=True, slots=True)
class Ports:
    """Where an installation listens, on the loopback interface."""

    router: int = PORTS["router"][0]
    rest: int = PORTS["rest"][0]
    dicom: int = PORTS["dicom"][0]
    gcs: int = PORTS["gcs"][0]
    control: int = PORTS["control"][0]

    @staticmethod
    def any_free() -> "Ports":
        """Five ports that nobody uses now."""
        return Ports(*free_ports(5))

    @property
    def rest_url(self) -> str:
        """Address of a gateway that listens on the loopback interface without TLS."""
        return f"http://127.0.0.1:{self.rest}"

    @property
    def control_url(self) -> str:
        """Address of the virtual operating room's control API."""
        return f"http://127.0.0.1:{self.control}"


@dataclass(frozen=True, slots=True)
class SiteLink:
    """Where a room shows itself to the hospital's control desk, and the folder of its keys for that."""

    endpoint: str
    keys: Path


@dataclass(frozen=True, slots=True)
class Installation:
    """What to run.

    Attributes
    ----------
    controller_url
        pyserial URL of the real hexapod controller; None to run the virtual operating room instead.
    scenario_arguments
        How to choose the virtual room's scenario: ``("--seed", "3")`` or ``("--scenario", FILE)``.
    plain_bus
        Whether the bus does without TLS and access control: whoever reaches its port may then say anything.
    https
        Whether the gateway speaks HTTPS, with a certificate of the installation's authority for the network.
    site
        None for a room that shows itself nowhere.
    """

    ports: Ports
    state_dir: Path
    controller_url: str | None = None
    scenario_arguments: tuple[str, ...] = ()
    plain_bus: bool = False
    https: bool = False
    site: SiteLink | None = None

    @property
    def rest_host(self) -> str:
        """Where the gateway listens: the loopback interface, unless its setting names another address."""
        return os.environ.get(_REST_HOST, _LOOPBACK)

    @property
    def gateway(self) -> Server:
        """The gateway, as programs of this machine call it."""
        host = _LOOPBACK if self.rest_host in _EVERY_ADDRESS else self.rest_host
        named = f"[{host}]" if ":" in host else host
        if not self.https:
            return Server(f"http://{named}:{self.ports.rest}")
        authority = TlsFiles.in_network(self.state_dir, REST).authority
        return Server(f"https://{named}:{self.ports.rest}", None if _OWN_CERTIFICATE in os.environ else authority)

    @property
    def router_endpoint(self) -> str:
        """Where the router listens, and with which protocol."""
        return f"{'tcp' if self.plain_bus else 'tls'}/127.0.0.1:{self.ports.router}"

    @property
    def dicom_address(self) -> str:
        """Where images are received: the loopback interface, unless the setting of imaging names another one."""
        return f"{os.environ.get(_DICOM_HOST, _LOOPBACK)}:{self.ports.dicom}"

    @property
    def simulated(self) -> bool:
        """Whether the virtual operating room stands where the hospital's hardware would stand."""
        return self.controller_url is None

    @property
    def takes_unapproved_parts(self) -> bool:
        """Whether part files need no approval: in a simulation, unless the gateway's setting says otherwise."""
        return self.simulated and _UNAPPROVED_PARTS not in os.environ

    @property
    def token(self) -> str:
        """The token of the user `demo`, whom a simulation has; programs send it with every request."""
        return demo_token(self.state_dir)

    def require_free_ports(self) -> None:
        """Refuse ports in use before anything starts; raises `ConfigurationError`."""
        for name, used_for in self._listening():
            require_free_port(getattr(self.ports, name), used_for, f"--{name}-port")

    def specs(self) -> list[ProcessSpec]:
        """Processes in the order of starting; the gateway is last, and ready when all services are alive."""
        ports, environment = self.ports, self._environment()
        router = ProcessSpec(
            "router",
            "shared.bus.router",
            lambda: tcp_port_answers(ports.router),
            ("--listen", self.router_endpoint, *self._router_arguments()),
        )
        services = [
            ProcessSpec("imaging", "services.imaging", _at_once, environment=environment),
            ProcessSpec("registration", "services.registration", _at_once, environment=environment),
            ProcessSpec("robot", "services.robot", _at_once, environment=environment),
            ProcessSpec("ui_api", "services.ui_api", GatewayReady(self.gateway), (), environment),
        ]
        room = [self._virtual_room(environment)] if self.simulated else []
        return [router, *room, *services, *([] if self.site is None else [self._exporter(self.site)])]

    def _exporter(self, site: SiteLink) -> ProcessSpec:
        """Last, and missed by nobody: a room works without the hospital."""
        files = () if self.plain_bus else _named(TlsFiles.in_state(self.state_dir, EXPORTER))
        room = ("--room", load_settings(ServiceSettings).room, "--router", self.router_endpoint)
        shown = ("--site", site.endpoint, "--site-keys", str(site.keys))
        return ProcessSpec(EXPORTER, "shared.bus.exporter", _at_once, (*room, *files, *shown))

    def _virtual_room(self, environment: Mapping[str, str]) -> ProcessSpec:
        ports = self.ports
        arguments = (
            *("--gcs-port", str(ports.gcs)),
            *("--control-port", str(ports.control)),
            *("--dicom-target", self.dicom_address.replace("0.0.0.0", _LOOPBACK)),  # noqa: S104 - not bound here
            *self.scenario_arguments,
        )
        return ProcessSpec(
            "virtual-or", "simulation", lambda: Server(ports.control_url).answers_ok("/healthz"), arguments, environment
        )

    def _environment(self) -> dict[str, str]:
        return {
            "DISTALOCK_ROUTER_ENDPOINT": self.router_endpoint,
            "DISTALOCK_STATE_DIR": str(self.state_dir),
            _DICOM_HOST: self.dicom_address.rpartition(":")[0],
            "DISTALOCK_IMAGING_DICOM_PORT": str(self.ports.dicom),
            "DISTALOCK_ROBOT_CONTROLLER_URL": self.controller_url or f"socket://127.0.0.1:{self.ports.gcs}",
            "DISTALOCK_UI_API_PORT": str(self.ports.rest),
            **({"DISTALOCK_UI_API_HTTPS": "true"} if self.https else {}),
            # In a simulation nobody is at risk, and programs try parts of their own.
            **({_UNAPPROVED_PARTS: "true"} if self.takes_unapproved_parts else {}),
            **({DEMO_TOKEN: str(self.state_dir / TOKEN_FILE)} if self.simulated else {}),
            **({_VIRTUAL_ROOM: self.ports.control_url} if self.simulated else {}),
        }

    def _router_arguments(self) -> tuple[str, ...]:
        if self.plain_bus:
            return ("--plain-bus",)
        files = TlsFiles.in_state(self.state_dir, ROUTER)
        return ("--room", load_settings(ServiceSettings).room, *_named(files))

    def fleet(
        self,
        stop: threading.Event,
        start_patience_s: float = 60.0,
        change: Callable[[ProcessSpec], ProcessSpec] = lambda spec: spec,
    ) -> Fleet:
        """The processes, not yet started; setting `stop` ends their starting and their being watched.

        `change` may replace what is run: for test rigs.
        """
        return Fleet(
            [change(spec) for spec in self.specs()],
            self.state_dir / "logs",
            start_patience_s,
            stop,
            reservations=self._reservations(),
            prepare=self.make_keys,
        )

    def _reservations(self) -> dict[str, str]:
        """What no other installation may use, with the remedy."""
        end_it = "end it, or choose another"
        wanted = {f"port {getattr(self.ports, name)}": f"{end_it} with --{name}-port" for name, _ in self._listening()}
        if self.controller_url is not None:
            wanted[f"the hexapod controller at {self.controller_url}"] = f"{end_it} with --controller"
        return wanted

    def _listening(self) -> list[tuple[str, str]]:
        listening = [("router", "the router"), ("rest", "the REST gateway"), ("dicom", "DICOM reception")]
        if self.simulated:
            listening += [
                ("gcs", "the virtual hexapod controller"),
                ("control", "the virtual operating room's control"),
            ]
        return listening

    def make_keys(self) -> None:
        """Make the authority at the first start, and what is missing or ends soon at every other.

        A plain bus has no use for certificates, but permits to move are signed on it, too.
        """
        folder, now = self.state_dir / PKI_FOLDER, datetime.now(UTC)
        if self.simulated:
            demo_token(self.state_dir)
        for keystore in (Keystore(folder), network_keystore(folder)):
            keystore.ensure(now)

    def write_directory(self, pids: Mapping[str, int]) -> Path:
        """Write who runs where to `installation.json` in the state folder, for tools and tests."""
        file = self.state_dir / "installation.json"
        content = {"ports": asdict(self.ports), "pids": dict(pids), "simulated": self.simulated}
        file.write_text(json.dumps(content, indent=1) + "\n")
        return file


def _named(files: TlsFiles) -> tuple[str, ...]:
    return ("--authority", str(files.authority), "--certificate", str(files.certificate), "--key", str(files.key))


def _at_once() -> bool:
    return True

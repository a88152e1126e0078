"""A composed installation with a virtual operating room: its commands, and the handles that a test takes it by."""

import json
import os
import shutil
import subprocess
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Final

from distalock.local_ports import free_ports
from distalock.readiness import Server
from distalock.version import revision
from shared.bus.shared_memory import LOCKED_BYTES, MemoryLimits, pool_bytes
from shared.errors import ConfigurationError
from tools.containers.base_image import BASE_VARIABLE, base_image

ROOT: Final = Path(__file__).resolve().parents[2]
# Containers of the product; the virtual operating room is no part of it.
SERVICES: Final = ("router", "imaging", "registration", "guardian", "robot", "ui_api")
IMAGES: Final = ("router", "robot", "ui_api", "registration", "imaging", "pki", "virtual-or")
_NETWORK: Final = "bus"
_LAST_WORDS: Final = 4000
_TOKEN: Final = "/run/distalock/demo/demo-token"  # noqa: S105 - a file's name
_AUTHORITY: Final = "/run/distalock/https/authority.pem"


def compose_command() -> list[str]:
    """`docker compose`, or docker-compose 1.29; raises `ConfigurationError` when neither is there."""
    if shutil.which("docker") is not None:
        if subprocess.run(["docker", "compose", "version"], check=False, capture_output=True).returncode == 0:
            return ["docker", "compose"]
        if shutil.which("docker-compose") is not None:
            return ["docker-compose"]
    raise ConfigurationError("there is neither `docker compose` nor docker-compose; install docker and one of them")


@cache
def limits_of_docker(image: str) -> Mapping[str, str]:
    """Limits that containers can have where docker may not raise its own to those of the compose file."""
    wanted = ["--ulimit", f"memlock={LOCKED_BYTES}", "--ulimit", "rtprio=1"]
    if _runs(*wanted, image):
        return {}
    said = subprocess.run(_run_words("", image, "sh", "-c", "ulimit -Hl"), check=True, capture_output=True, text=True)
    lockable_bytes = int(said.stdout) * 1024
    pool_mib = pool_bytes(MemoryLimits(lockable_bytes, 0)) / 2**20
    print(
        "docker may raise neither locked memory nor real-time scheduling here: "
        + (f"frames go by a pool of {pool_mib:g} MiB" if pool_mib else "frames go by TCP"),
        flush=True,
    )
    return {"DISTALOCK_MEMLOCK": str(lockable_bytes), "DISTALOCK_RTPRIO": "0"}


def _runs(*words: str) -> bool:
    return subprocess.run(_run_words(*words, "true"), check=False, capture_output=True).returncode == 0


def _run_words(*words: str) -> list[str]:
    return ["docker", "run", "--rm", "--network", "none", *(word for word in words if word)]


@dataclass(frozen=True, slots=True)
class Composition:
    """One installation of containers, on ports of its own on the loopback interface.

    Attributes
    ----------
    project
        Name of the project of compose: part of the names of containers, volumes and networks.
    """

    project: str
    base: str = field(default_factory=base_image)
    ports: tuple[int, ...] = field(default_factory=lambda: tuple(free_ports(3)))
    command: tuple[str, ...] = field(default_factory=lambda: tuple(compose_command()))

    @property
    def environment(self) -> Mapping[str, str]:
        """Variables of the compose file."""
        rest, control, dicom = self.ports
        version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
        return {
            **os.environ,
            BASE_VARIABLE: self.base,
            "COMPOSE_PROJECT_NAME": self.project,
            "DISTALOCK_ENVIRONMENT": "simulation",
            "DISTALOCK_REVISION": revision() or "",
            "DISTALOCK_VERSION": str(version),
            **limits_of_docker(self.base),
            "DISTALOCK_REST_ADDRESS": f"127.0.0.1:{rest}",
            "DISTALOCK_CONTROL_ADDRESS": f"127.0.0.1:{control}",
            "DISTALOCK_DICOM_ADDRESS": f"127.0.0.1:{dicom}",
        }

    @property
    def room_url(self) -> str:
        """Control API of the virtual operating room."""
        return f"http://127.0.0.1:{self.ports[1]}"

    def server(self, folder: Path) -> Server:
        """The gateway, with its authority's certificate in a folder."""
        authority = folder / "authority.pem"
        authority.write_bytes(self.file_of("ui_api", _AUTHORITY))
        return Server(f"https://127.0.0.1:{self.ports[0]}", authority)

    def token(self) -> str:
        """Access token of the user demo."""
        return self.file_of("ui_api", _TOKEN).decode("ascii").strip()

    def build(self) -> None:
        """Build all images."""
        self.compose("--profile", "simulate", "build", quiet=True)

    def up(self, *services: str) -> None:
        """Start everything, or some services."""
        self.compose("--profile", "simulate", "up", "--detach", "--no-build", *services, quiet=True)

    def down(self) -> None:
        """Stop everything and leave nothing behind, volumes neither."""
        self.compose("--profile", "simulate", "down", "--volumes", "--timeout", "20", quiet=True)

    def compose(self, *words: str, quiet: bool = False) -> bytes:
        """Run a command of compose; raises `ConfigurationError` with what it has said last when it fails."""
        return self._run([*self.command, *words], quiet=quiet)

    def docker(self, *words: str) -> bytes:
        """Run a command of docker; raises like `compose`."""
        return self._run(["docker", *words])

    def _run(self, words: list[str], *, quiet: bool = False) -> bytes:
        ended = subprocess.run(words, cwd=ROOT, env=self.environment, check=False, capture_output=True)
        if ended.returncode != 0:
            said = (ended.stdout[-4000:] if quiet else b"") + ended.stderr[-4000:]
            raise ConfigurationError(
                f"{' '.join(words)} ended with {ended.returncode}: {said.decode(errors='replace')}"
            )
        return ended.stdout

    def file_of(self, service: str, path: str) -> bytes:
        """Content of a file in a container."""
        return self.docker("exec", self.container(service), "cat", path)

    def logs(self, service: str) -> str:
        """What a container has logged."""
        return self.compose("logs", "--no-color", service).decode(errors="replace")

    def container(self, service: str) -> str:
        """Id of a service's container."""
        return self.compose("ps", "--quiet", service).decode().strip()

    def pid(self, service: str) -> int:
        """Process id of a container's first process, as this machine counts."""
        return int(self._inspected(self.container(service), "{{.State.Pid}}"))

    def health(self, service: str) -> str:
        """What a container's health check has found."""
        return self._inspected(self.container(service), "{{.State.Health.Status}}")

    def network(self) -> str:
        """Name of the network of the bus."""
        return f"{self.project}_{_NETWORK}"

    def layers_bytes(self, image: str) -> int:
        """Size of an image's layers above the base."""
        whole, base = (self._inspected(name, "{{.Size}}") for name in (f"distalock/{image}", self.base))
        return int(whole) - int(base)

    def labels(self, image: str) -> Mapping[str, str]:
        """Labels of an image."""
        found: dict[str, str] = json.loads(self._inspected(f"distalock/{image}", "{{json .Config.Labels}}"))
        return found

    def _inspected(self, name: str, what: str) -> str:
        return self.docker("inspect", "--format", what, name).decode().strip()

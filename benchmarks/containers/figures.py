"""Figures of containers: the first image beside the second, frames by shared memory, memory."""

import re
import time
from dataclasses import dataclass
from typing import Final

import httpx

from benchmarks.containers.site import ContainerSite
from distalock.case_client import CaseClient
from distalock.robot_readiness import make_robot_ready

FRAMES: Final = 12
_METRIC: Final = re.compile(r'^distalock_frames\{path="(\w+)"\} ([0-9.e+]+)$', re.MULTILINE)


@dataclass(frozen=True, slots=True)
class ImageTimes:
    """From the request of a shot to its localisation, in a room that has just been started."""

    first_s: float
    second_s: float

    @property
    def ratio(self) -> float:
        """How much longer the first one took."""
        return self.first_s / self.second_s


def image_times(site: ContainerSite) -> ImageTimes:
    """The first two images of an installation; the room has rendered one before, and has nothing to prepare."""
    site.room.room.take_shot()
    case = CaseClient.opened(site.gateway, site.room.room.scenario().set_up)
    make_robot_ready(site.gateway)
    first_s, second_s = _image_s(site, case), _image_s(site, case)
    case.abandon("the times are known")
    return ImageTimes(first_s, second_s)


def _image_s(site: ContainerSite, case: CaseClient) -> float:
    """From the arrival of an image, when the room's request returns, to its localisation."""
    uid = site.room.room.take_shot()
    began_s = time.monotonic()
    case.localisation_of(uid)
    return time.monotonic() - began_s


def frames_by_path(site: ContainerSite, count: int = FRAMES) -> dict[str, int]:
    """How many frames came to the gateway by which way, from its start on, after some more."""
    for _ in range(count):
        site.room.room.take_shot()
    answer = httpx.get(f"{site.server.url}/metrics", verify=site.server.trusted())
    return {path: int(float(value)) for path, value in _METRIC.findall(answer.text)}


def resident_mib(site: ContainerSite, service: str) -> float:
    """Resident memory of a container's first process."""
    with open(f"/proc/{site.composition.pid(service)}/status", encoding="ascii") as status:  # noqa: PTH123 - a line of it
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024.0

"""From an X-ray that comes in to a plan that is ready, beside `locate` in a process that has localised before.

usage: distalock bench image_to_plan [--pairs 20] [--scenario 3] [--report FILE]

A real installation with the virtual operating room; no robot moves. One accepted image is sent again and again by
DICOM, each time under a new SOP instance UID, so that it is a new image to everybody. A console that follows the events
asks for a plan as soon as it hears of the localisation; the plan is ready when its request is answered. In turn with
it, this process localises the same file, read anew (`distalock.locate.locate_image`, what the command runs).
"""

import argparse
import io
import json
import os
import queue
import random
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

import httpx
import numpy as np
import pydicom
from pydicom.uid import generate_uid
from pynetdicom import AE
from pynetdicom.sop_class import XRayAngiographicImageStorage  # type: ignore[attr-defined]

from benchmarks.common.operating_room import OperatingRoom, running
from benchmarks.common.places import CATALOGUE, PAGES
from benchmarks.gateway.accepted_view import accepted_localisation
from distalock.arguments import seed_number, whole_number, writable_file
from distalock.installation import Installation, Ports
from distalock.locate import locate_image, read_parts
from distalock.rest_client import JsonObject, bearer
from distalock.robot_readiness import make_robot_ready
from services.registration.core.localise import Parts
from shared.arguments import OneLineParser

REPORT: Final = PAGES / "image-to-plan.md"
PAIRS: Final = 20
SCENARIO: Final = 3
LARGEST_RATIO: Final = 1.3
_WARM_UP: Final = 2
_PATIENCE_S: Final = 120.0


@dataclass(frozen=True, slots=True)
class Pair:
    """Seconds of one turn, each from the image on.

    Attributes
    ----------
    delivered_s
        Until imaging had acknowledged it.
    localised_s
        Until the console heard of the localisation.
    planned_s
        Until the plan was there.
    """

    delivered_s: float
    localised_s: float
    planned_s: float
    locate_s: float


class Console:
    """Follows a case's events, and asks for plans."""

    def __init__(self, http: httpx.Client, case_id: str, hole_ids: Sequence[str]) -> None:
        self._http, self._path, self._hole_ids = http, f"/api/v1/cases/{case_id}", tuple(hole_ids)
        self._heard: queue.Queue[JsonObject] = queue.Queue()
        self._etag = http.get(self._path).headers["etag"]
        newest = int(http.get(self._path).json()["localisations"])
        self._following = threading.Thread(target=self._follow, args=(newest,), daemon=True)
        self._following.start()

    def localisation(self) -> int:
        """Number of the next localisation, as soon as it is heard of."""
        return int(str(self._heard.get(timeout=_PATIENCE_S)["number"]))

    def plan(self, localisation: int) -> None:
        """Ask for a plan and wait until it is there."""
        headers = {"Idempotency-Key": str(uuid.uuid4()), "If-Match": self._etag}
        body = {"localisation": localisation, "hole_ids": list(self._hole_ids)}
        answer = self._http.post(f"{self._path}/plans", json=body, headers=headers)
        if answer.is_error:
            raise RuntimeError(f"no plan: {answer.text}")
        self._etag = answer.headers["case-etag"]

    def _follow(self, newest: int) -> None:
        with self._http.stream("GET", f"{self._path}/events", timeout=None) as stream:
            for line in stream.iter_lines():
                if line.startswith("data: "):
                    event = json.loads(line.removeprefix("data: "))
                    data = event["data"]
                    if event["kind"] == "localisation_received" and int(data["number"]) > newest:
                        self._heard.put(data)


@dataclass(frozen=True, slots=True)
class Bench:
    """Everything that takes turns."""

    console: Console
    dicom_address: tuple[str, int]
    image: pydicom.Dataset
    parts: Parts
    folder: Path

    def pair(self) -> Pair:
        """One turn."""
        self.image.SOPInstanceUID = self.image.file_meta.MediaStorageSOPInstanceUID = generate_uid()
        file = self.folder / "image.dcm"
        self.image.save_as(file)
        began_s = time.perf_counter()
        locate_image(file, self.parts)
        locate_s, began_s = time.perf_counter() - began_s, time.perf_counter()
        self._send()
        delivered_s = time.perf_counter() - began_s
        number = self.console.localisation()
        localised_s = time.perf_counter() - began_s
        self.console.plan(number)
        return Pair(delivered_s, localised_s, time.perf_counter() - began_s, locate_s)

    def _send(self) -> None:
        entity = AE(ae_title="BENCHMARK")
        entity.add_requested_context(XRayAngiographicImageStorage, self.image.file_meta.TransferSyntaxUID)
        association = entity.associate(*self.dicom_address, ae_title="DISTALOCK")
        if not association.is_established or association.send_c_store(self.image).Status != 0:
            raise RuntimeError("imaging did not take the image")
        association.release()


@contextmanager
def bench_of(scenario: int) -> Iterator[Bench]:
    """An installation with an open case and an accepted image."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="distalock-image-to-plan-")))
        installation = Installation(Ports.any_free(), folder / "state", None, ("--seed", str(scenario)))
        room = stack.enter_context(running(installation))
        make_robot_ready(room.gateway)
        case = room.open_case()
        accepted_localisation(room, case, random.Random(scenario))
        http = stack.enter_context(
            httpx.Client(base_url=installation.ports.rest_url, headers=bearer(installation.token), timeout=_PATIENCE_S)
        )
        console = Console(http, case.id, room.room.scenario().hole_ids)
        image = pydicom.dcmread(io.BytesIO(room.control.get_bytes("/shots/last.dcm")))
        host, _, port = installation.dicom_address.rpartition(":")
        yield Bench(console, (host, int(port)), image, _parts(room, folder), folder)


def _parts(room: OperatingRoom, folder: Path) -> Parts:
    """The parts of the case, as `locate` reads them."""
    set_up = room.room.scenario().set_up
    ring, guide, nail = (_part_file(folder, kind, set_up[kind]) for kind in ("ring", "guide", "nail"))
    return read_parts(ring, guide, nail)


def _part_file(folder: Path, kind: str, part: object) -> Path:
    """The file of a part of the catalogue, or one with the part itself."""
    if isinstance(part, str):
        return CATALOGUE / f"{part}.json"
    file = folder / f"{kind}.json"
    file.write_text(json.dumps(part))
    return file


def main(arguments: Sequence[str] = ()) -> int:
    """Measure, write the page; 1 when the ratio is above its limit."""
    given = _options(arguments)
    with bench_of(given.scenario) as bench:
        pairs = [bench.pair() for _ in range(_WARM_UP + given.pairs)][_WARM_UP:]
    page = page_of(pairs, given.scenario)
    given.report.write_text(page)
    print(page)
    return 0 if ratio_of(pairs) <= LARGEST_RATIO else 1


def ratio_of(pairs: Sequence[Pair]) -> float:
    """Median over the pairs."""
    return median(one.planned_s / one.locate_s for one in pairs)


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(prog="distalock bench image_to_plan", description="from an X-ray to a plan, beside locate")
    parser.add_argument("--pairs", type=whole_number("a number of pairs", 1, 10**4), default=PAIRS, help=f"({PAIRS})")
    parser.add_argument("--scenario", type=seed_number, default=SCENARIO, help=f"seed of the room ({SCENARIO})")
    parser.add_argument("--report", type=writable_file, default=REPORT, help="file for the page")
    return parser.parse_args(list(arguments))


def page_of(pairs: Sequence[Pair], scenario: int) -> str:
    """The page."""
    rows = "".join(
        _row(name, seconds, [one.locate_s for one in pairs])
        for name, seconds in (
            ("image stored and acknowledged", [one.delivered_s for one in pairs]),
            ("localisation heard of by a console that follows the events", [one.localised_s for one in pairs]),
            ("plan ready", [one.planned_s for one in pairs]),
            ("`locate` in a warm process, on the same file", [one.locate_s for one in pairs]),
        )
    )
    return (
        "# From an X-ray to a plan\n\n"
        f"Made by `distalock bench image_to_plan --pairs {len(pairs)} --scenario {scenario}`: a real installation with "
        "the virtual operating room. One accepted image comes in by DICOM\nagain and again under new instance UIDs; in "
        "turn with it, a process localises the same file. Times are from the beginning of the DICOM association; "
        "ratios are\nmedians of the ratios within a pair.\n\n"
        "| | median | 95 % | ratio to `locate` |\n|---|---|---|---|\n"
        f"{rows}| limit, of the plan | | | {LARGEST_RATIO:g} |\n\n"
        f"Load average of the five minutes before the end of this run: {os.getloadavg()[1]:.1f}, "
        f"on {os.cpu_count()} processors.\n"
    )


def _row(name: str, seconds: Sequence[float], locate_s: Sequence[float]) -> str:
    ratio = median(one / other for one, other in zip(seconds, locate_s, strict=True))
    return f"| {name} | {median(seconds):.3f} s | {np.percentile(seconds, 95.0):.3f} s | {ratio:.2f} |\n"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

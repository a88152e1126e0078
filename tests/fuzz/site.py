"""The system that is asked: an installation with an account for each role, an open case, an image and a plan."""

import os
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.common.operating_room import WITHOUT_RATE_LIMITS
from distalock.case_client import CaseClient
from distalock.client import Client, RequestRefused
from distalock.client.models import PlanView, UserBody
from distalock.installation import Installation, Ports
from distalock.rest_client import RestClient
from distalock.room_client import RoomClient
from services.ui_api.core.roles import Role

SEED: Final = 2
PASSWORD: Final = "four words and a nail"
_START_WITHIN_S: Final = 600.0
_SETTLES_S: Final = 1.5
_MOST_IMAGES: Final = 8


@dataclass(frozen=True, slots=True)
class FuzzSite:
    """A running system, and what of it requests can name.

    Attributes
    ----------
    known
        A value for each parameter of a path that names something there is.
    """

    url: str
    known: dict[str, object]
    plan_etag: str


def account_of(role: Role) -> str:
    """Name of the account with a role."""
    return f"a.{role}"


@contextmanager
def fuzz_site() -> Iterator[FuzzSite]:
    """Start everything; gone afterwards."""
    os.environ |= WITHOUT_RATE_LIMITS
    with tempfile.TemporaryDirectory(prefix="distalock-fuzz-") as folder:
        installation = Installation(Ports.any_free(), Path(folder), scenario_arguments=("--seed", str(SEED)))
        with (
            installation.fleet(threading.Event(), _START_WITHIN_S),
            Client(installation.gateway.url, installation.token) as client,
            RestClient(installation.ports.control_url) as control,
        ):
            for role in Role:
                client.create_user(UserBody(name=account_of(role), password=PASSWORD, roles=(role.value,)))
            yield _with_case(client, RoomClient(control), installation.gateway.url)


def _with_case(client: Client, room: RoomClient, url: str) -> FuzzSite:
    scenario = room.scenario()
    case = CaseClient.opened(client, scenario.set_up)
    acknowledged, _ = case.make_robot_ready()
    plan = _planned(case, room, scenario.hole_ids)
    known: dict[str, object] = {
        "case_id": case.id,
        "image_id": case.newest_image_id(),
        "number": 1,
        "operation_id": acknowledged.id,
        "name": "ring-120",
    }
    return FuzzSite(url, known, f'"{plan.sha256}"')


def _planned(case: CaseClient, room: RoomClient, hole_ids: Sequence[str]) -> PlanView:
    """A plan from an image of a robot that has stood still for long enough."""
    for _ in range(_MOST_IMAGES - 1):
        time.sleep(_SETTLES_S)
        seen = case.localisation_of(room.take_shot())
        with suppress(RequestRefused):
            return case.plan(seen.number, hole_ids)
    return case.plan(case.localisation_of(room.take_shot()).number, hole_ids)

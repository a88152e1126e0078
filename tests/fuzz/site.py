"""The system that is asked: an installation with an account for each role, an open case, an image and a plan."""

import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks.common.operating_room import WITHOUT_RATE_LIMITS
from distalock.case_client import CaseClient
from distalock.client import Client, RequestRefused
from distalock.client.models import PlanView, UserBody
from distalock.installation import Installation, Ports
from distalock.processes import ProcessSpec
from distalock.rest_client import RestClient
from distalock.robot_readiness import make_robot_ready
from distalock.room_client import RoomClient
from services.ui_api.core.roles import Role

SEED: Final = 2
PASSWORD: Final = "four words and a nail"
# Whom requests about accounts name.
OTHER_ACCOUNT: Final = "a.nobody"
_START_WITHIN_S: Final = 600.0
_SETTLES_S: Final = 1.5
_MOST_IMAGES: Final = 8


@dataclass(frozen=True, slots=True)
class ThereIs:
    """What requests can name.

    Attributes
    ----------
    known
        A value for each parameter of a path that names something there is.
    """

    known: Mapping[str, object]
    plan_etag: str


@dataclass(frozen=True, slots=True)
class FuzzSite:
    """A running system.

    Attributes
    ----------
    administrator
        Token of an administrator, who mends an account that a generated request has changed.
    fresh_case
        Makes a new open case with an image and a plan; whatever was open before is abandoned.
    """

    url: str
    administrator: str
    fresh_case: Callable[[], ThereIs]


def abandon_open_cases(client: Client) -> None:
    """Leave none open."""
    for case in CaseClient.open_cases(client):
        case.abandon("the next role begins with a case of its own")


def account_of(role: Role) -> str:
    """Name of the account with a role."""
    return f"a.{role}"


@contextmanager
def installation_site() -> Iterator[FuzzSite]:
    """Start everything, with the virtual operating room; gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="distalock-fuzz-") as folder:
        installation = Installation(Ports.any_free(), Path(folder), scenario_arguments=("--seed", str(SEED)))
        with (
            installation.fleet(threading.Event(), _START_WITHIN_S, _without_rate_limits),
            Client(installation.gateway.url, installation.token) as client,
            RestClient(installation.ports.control_url) as control,
        ):
            for role in Role:
                client.create_user(UserBody(name=account_of(role), password=PASSWORD, roles=(role.value,)))
            client.create_user(UserBody(name=OTHER_ACCOUNT, password=PASSWORD, roles=("viewer",)))
            fresh_case = partial(_with_case, client, RoomClient(control))
            yield FuzzSite(installation.gateway.url, installation.token, fresh_case)


def _with_case(client: Client, room: RoomClient) -> ThereIs:
    abandon_open_cases(client)
    scenario = room.scenario()
    case = CaseClient.opened(client, scenario.set_up)
    make_robot_ready(client)
    plan = _planned(case, room, scenario.hole_ids)
    known: dict[str, object] = {
        "case_id": case.id,
        "image_id": case.newest_image_id(),
        "number": 1,
        "operation_id": client.list_operations(limit=1).items[0].id,
        "name": "ring-120",
    }
    return ThereIs(known, f'"{plan.sha256}"')


def _without_rate_limits(spec: ProcessSpec) -> ProcessSpec:
    return replace(spec, environment={**spec.environment, **WITHOUT_RATE_LIMITS})


def _planned(case: CaseClient, room: RoomClient, hole_ids: Sequence[str]) -> PlanView:
    """A plan from an image of a robot that has stood still for long enough."""
    for _ in range(_MOST_IMAGES - 1):
        time.sleep(_SETTLES_S)
        seen = case.localisation_of(room.take_shot())
        with suppress(RequestRefused):
            return case.plan(seen.number, hole_ids)
    return case.plan(case.localisation_of(room.take_shot()).number, hole_ids)

"""A whole installation of real processes with the virtual operating room, for tests that speak REST only."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchmarks.common.operating_room import OperatingRoom, running
from distalock.installation import Installation, Ports

SEED = 2
# Longer than registration's `image_delay_s`: no plan is made from an image that comes sooner after the robot moved, or
# was locked again.
RESTED_S = 0.6


@contextmanager
def operating_room(folder: Path, seed: int) -> Iterator[OperatingRoom]:
    """Start everything, and leave nothing behind."""
    with running(Installation(Ports.any_free(), folder, scenario_arguments=("--seed", str(seed)))) as room:
        yield room


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OperatingRoom]:
    """A fresh installation for a file's tests."""
    print(f"scenario seed {SEED}")
    with operating_room(tmp_path_factory.mktemp("room"), SEED) as room:
        yield room


def shot_at_rest(room: OperatingRoom) -> str:
    """Take an image as a person does, not in the moment in which the robot is locked again; its SOP Instance UID."""
    time.sleep(RESTED_S)
    return room.room.take_shot()

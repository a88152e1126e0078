"""Each process killed and stopped in motion: at rest and locked within half a second and a millimetre."""

import signal
from collections.abc import Iterator
from itertools import product

import pytest

from benchmarks.faults.process_loss import INSTALLATION, SERVICES, SIGNALS, Site, lose, services_site, up_site

pytestmark = [pytest.mark.slow, pytest.mark.alone, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def services(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """One installation for all of them."""
    with services_site(tmp_path_factory.mktemp("room")) as site:
        yield site


@pytest.mark.parametrize(("process", "number"), list(product(SERVICES, SIGNALS)))
def test_a_process_that_is_lost_in_motion_leaves_the_robot_locked(
    services: Site, process: str, number: signal.Signals
) -> None:
    loss = lose(services, process, number)
    print(loss)
    assert loss.within_limits, loss


def test_an_installation_that_hangs_and_is_killed_in_motion_leaves_the_robot_locked(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    with up_site(tmp_path_factory.mktemp("up")) as site:
        for number in (signal.SIGSTOP, signal.SIGKILL):
            loss = lose(site, INSTALLATION, number)
            print(loss)
            assert loss.within_limits, loss

"""Processes killed and stopped in motion: at rest and locked within half a second and a millimetre.

Here are the two whose loss only the guardian, or only those that it has started, notice; `distalock bench process_loss`
tries all.
"""

import signal
from collections.abc import Iterator

import pytest

from benchmarks.faults.process_loss import INSTALLATION, Site, lose, services_site, up_site

pytestmark = [pytest.mark.slow, pytest.mark.alone, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def services(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """One installation for all of them."""
    with services_site(tmp_path_factory.mktemp("room")) as site:
        yield site


@pytest.mark.requirement("ROB-07")
@pytest.mark.parametrize("number", [pytest.param(signal.SIGKILL, marks=pytest.mark.long), signal.SIGSTOP])
def test_a_robot_service_that_is_lost_in_motion_leaves_the_robot_locked(services: Site, number: signal.Signals) -> None:
    loss = lose(services, "robot", number)
    print(loss)
    assert loss.within_limits, loss


@pytest.mark.requirement("OPS-01")
def test_an_installation_that_hangs_in_motion_leaves_the_robot_locked(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    with up_site(tmp_path_factory.mktemp("up")) as site:
        loss = lose(site, INSTALLATION, signal.SIGSTOP)
        print(loss)
        assert loss.within_limits, loss

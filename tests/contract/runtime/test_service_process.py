"""Services and router as real processes: how they come, go, die and hang."""

import json
import os
import queue
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from shared.bus.keys import Keys
from shared.bus.zenoh_bus import BusSettings, open_bus
from shared.errors import BusUnavailable
from tests.contract.bus.rooms import PATIENCE_S, RouterProcess, free_port

# The lease that services announce is 1 s; Zenoh checks it four times as often. The rest is for a busy machine.
HANG_NOTICED_WITHIN_S = 20.0
KEYS = Keys("test")


@pytest.fixture(scope="module")
def router() -> Iterator[RouterProcess]:
    with RouterProcess() as router:
        yield router


def start(endpoint: str, router_timeout_s: float = PATIENCE_S) -> subprocess.Popen[str]:
    environment = {
        **os.environ,
        "DISTALOCK_ROOM": "test",
        "DISTALOCK_ROUTER_ENDPOINT": endpoint,
        "DISTALOCK_ROUTER_TIMEOUT_S": str(router_timeout_s),
    }
    command = [sys.executable, "-m", "tests.contract.runtime.example_service"]
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)


@contextmanager
def watched_service(router: RouterProcess) -> Iterator[tuple[subprocess.Popen[str], "queue.Queue[bool]"]]:
    """A running service, and news of its liveliness token; the first, that it is alive, has been taken."""
    alive: queue.Queue[bool] = queue.Queue()
    with open_bus(BusSettings(router.endpoint, PATIENCE_S)) as bus:
        bus.watch_alive(KEYS.alive("robot"), lambda _key, up: alive.put(up))
        with start(router.endpoint) as service:
            try:
                assert alive.get(timeout=PATIENCE_S)
                yield service, alive
            finally:
                service.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_a_service_cleanly(router: RouterProcess, number: signal.Signals) -> None:
    with watched_service(router) as (service, alive):
        composed = iter(service.stderr or ())
        assert any('"composed"' in line for line in composed)
        service.send_signal(number)
        assert not alive.get(timeout=PATIENCE_S)
        assert any('"left cleanly"' in line for line in composed)
        assert service.wait(PATIENCE_S) == 0


def test_killed_service_is_gone(router: RouterProcess) -> None:
    with watched_service(router) as (service, alive):
        service.kill()
        assert not alive.get(timeout=PATIENCE_S)


def test_hung_process_is_noticed_within_its_lease(router: RouterProcess) -> None:
    with watched_service(router) as (service, alive):
        service.send_signal(signal.SIGSTOP)
        assert not alive.get(timeout=HANG_NOTICED_WITHIN_S)
        service.send_signal(signal.SIGCONT)
        assert alive.get(timeout=PATIENCE_S)


def test_hung_router_is_link_loss_within_its_lease() -> None:
    with RouterProcess() as router, watched_service(router) as (_, alive):
        router.send_signal(signal.SIGSTOP)
        assert not alive.get(timeout=HANG_NOTICED_WITHIN_S)
        router.send_signal(signal.SIGCONT)
        assert alive.get(timeout=PATIENCE_S)


def test_service_without_router_is_one_line_and_2() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with start(endpoint, 0.3) as service:
        _, said = service.communicate(timeout=PATIENCE_S)
    assert service.returncode == 2
    assert said.endswith(
        f"robot: no router answered at {endpoint} within 0.3 s; "
        "start the router (python -m shared.bus.router), or correct the endpoint or the certificates "
        "(distalock pki show)\n"
    )


def test_bus_without_router_gives_up_in_time() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    began = time.monotonic()
    with pytest.raises(BusUnavailable, match=rf"no router answered at {endpoint} within 0\.3 s; start the router"):
        open_bus(BusSettings(endpoint, 0.3))
    assert time.monotonic() - began < PATIENCE_S


def run_router(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "shared.bus.router", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


def test_second_router_on_a_port_is_one_line_and_2(router: RouterProcess) -> None:
    ran = run_router("--plain-bus", "--listen", router.endpoint)
    assert ran.returncode == 2
    assert ran.stderr.splitlines()[-1] == (
        f"router: {router.endpoint} is in use by another program; "
        "stop it or listen elsewhere (--listen tls/127.0.0.1:PORT)"
    )


def test_unusable_router_configuration_is_one_line_and_2() -> None:
    ran = run_router("--plain-bus", "--config", "/nonexistent.json5")
    assert ran.returncode == 2
    assert ran.stderr.startswith("router: router configuration /nonexistent.json5 cannot be used: No such file")
    assert len(ran.stderr.splitlines()) == 1


def test_router_ends_cleanly_on_sigterm() -> None:
    with RouterProcess() as router:
        router.send_signal(signal.SIGTERM)
        assert router.wait() == 0


def test_a_router_that_takes_anybody_must_be_asked_for_and_warns() -> None:
    listen = ("--listen", f"tcp/127.0.0.1:{free_port()}")
    refused = run_router(*listen)
    assert refused.returncode == 2
    assert refused.stderr == (
        "router: no --authority is given: name the router's files, which `distalock pki init` makes, or say that you "
        "want none (--plain-bus)\n"
    )
    printed = run_router("--plain-bus", *listen, "--print-config")
    assert (printed.returncode, printed.stderr) == (0, "")
    assert json.loads(printed.stdout)["mode"] == "router"

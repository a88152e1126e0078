"""Settings that hold for every test."""

import logging
import os
from collections.abc import Iterator

import pytest
from hypothesis import settings

from tests import kept, results_of_marks

# One core for each worker and for each process that it starts; the libraries read this when they are imported.
for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(_threads, "1")

# No test calls anybody whom the machine's certificates name: to read them anew for each client of http took a fifth of
# the time of the gateway's tests.
os.environ.pop("SSL_CERT_FILE", None)
os.environ["SSL_CERT_DIR"] = os.devnull

# The machine of a test may be as full as it likes; tests of that say what is full.
os.environ.setdefault("DISTALOCK_ANNOUNCE_FREE_PERCENT", "0")

# No deadlines: these machines are shared, and a slow example does not show an error of the code. The examples are the
# same in each run: a change that fails has broken something. `make search` looks for new ones, and prints with what
# they are reproduced.
settings.register_profile("distalock", deadline=None, derandomize=True)
settings.register_profile("search", deadline=None, print_blob=True, max_examples=1000)
settings.load_profile("distalock")


def pytest_configure(config: pytest.Config) -> None:
    """Keep slow results for all workers of the session, and how tests of requirements ended."""
    kept.begin(config)
    results_of_marks.begin(config)


@pytest.fixture(autouse=True)
def same_logging_afterwards() -> Iterator[None]:
    """Take back what a test has done to the process's logging: its lines would appear in what later tests print."""
    root = logging.getLogger()
    before, level = root.handlers, root.level
    yield
    root.handlers = before
    root.setLevel(level)

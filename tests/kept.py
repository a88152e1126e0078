"""Results that take seconds, made once a session and kept on disk for all tests, whichever worker asks first."""

import fcntl
import hashlib
import os
import pickle
import shutil
import tempfile
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

import pytest

P = ParamSpec("P")
R = TypeVar("R")

_FOLDER = "TEST_RESULTS_KEPT"


def begin(config: pytest.Config) -> None:
    """Make the folder, and remove it at the end; workers inherit its name from the process that made it."""
    if _FOLDER in os.environ:
        return
    folder = os.environ[_FOLDER] = tempfile.mkdtemp(prefix="distalock-tests-")
    config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))


def kept(function: Callable[P, R]) -> Callable[P, R]:
    """Call the function once for the same arguments in a session; every caller gets a copy of its own.

    The arguments must determine the result, and both must be picklable. Two workers that ask at the same time do not
    both work: the second waits for the first. Outside a session the function is called each time.
    """

    @wraps(function)
    def once(*args: P.args, **kwargs: P.kwargs) -> R:
        folder = os.environ.get(_FOLDER)
        if folder is None:
            return function(*args, **kwargs)
        asked = pickle.dumps((function.__module__, function.__qualname__, args, kwargs))
        file = Path(folder) / hashlib.sha256(asked).hexdigest()
        with file.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not file.exists():
                made = file.with_suffix(".made")
                made.write_bytes(pickle.dumps(function(*args, **kwargs)))
                made.rename(file)
        # what the session itself wrote a moment ago
        result: R = pickle.loads(file.read_bytes())
        return result

    return once

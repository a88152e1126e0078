"""What the contract tests of the controller share: where to move, and how to wait."""

import time
from collections.abc import Callable

from shared.geometry.hexapod import PlatformPose
from shared.parts.hexapod_file import default_hexapod

HEXAPOD = default_hexapod()
NEAR = PlatformPose(0.2, -0.1, 0.1, 0.1, -0.1, 0.2)
FAR = PlatformPose(6.0, 0.0, 0.0, 0.0, 0.0, 0.0)
WAIT_S = 60.0


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, "did not come true in time"
        time.sleep(0.001)

"""Three bytes in a thousand wrong: every motion is right or refused, and no answer is taken for another.

One in a hundred, and many more commands: `distalock bench robot_noise`.
"""

import random
import threading
from contextlib import suppress

import pytest

from services.robot.devices.controller import ControllerSilent
from services.robot.devices.gcs.controller import GcsController
from shared.errors import DeviceError
from shared.geometry.hexapod import PlatformPose
from shared.parts.hexapod_file import default_hexapod
from simulation.controller.gcs_protocol import Assembler
from simulation.controller.virtual_controller import VirtualController

HEXAPOD = default_hexapod()
MOVES = 150
WRONG_BYTES = 0.003
READ_WAIT_S = 0.01
# Short, as noise swallows many answers; a thread that waits for a processor may miss it on a quiet line too.
REPLY_TIMEOUT_S = 0.05
ATTEMPTS = 20


class NoisyPort:
    """A line to the virtual controller that spoils bytes at random, from when it is told to."""

    def __init__(self, virtual: VirtualController, noise: random.Random) -> None:
        self._virtual = virtual
        self._noise = noise
        self._assembler = Assembler()
        self._ready = threading.Condition()
        self._output = bytearray()
        self.noisy = False

    def read(self, size: int = 1, /) -> bytes:
        """As pyserial reads."""
        with self._ready:
            self._ready.wait_for(lambda: self._output, READ_WAIT_S)
            received = bytes(self._output[:size])
            del self._output[:size]
            return received

    def write(self, data: bytes, /) -> int:
        """As pyserial writes; the controller answers at once."""
        with self._ready:
            for command in self._assembler.feed(self._spoil(data)):
                self._output += self._spoil(self._virtual.receive(command))
            self._ready.notify_all()
        return len(data)

    def close(self) -> None:
        """Nothing to do."""

    def _spoil(self, content: bytes) -> bytes:
        if not self.noisy:
            return content
        spoiled = self._noise.randrange
        return bytes(spoiled(256) if self._noise.random() < WRONG_BYTES else byte for byte in content)


@pytest.mark.requirement("ROB-08")
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_with_noise_on_the_line_every_motion_is_right_or_refused(seed: int) -> None:
    noise = random.Random(seed)
    now_s = [0.0]
    virtual = VirtualController(HEXAPOD, lambda: now_s[0])
    begun = refused = 0

    def connect() -> tuple[NoisyPort, GcsController]:
        """As the service does after a fault, again while nothing answers; over a line that is quiet for that long."""
        for _ in range(ATTEMPTS):
            port = NoisyPort(virtual, noise)
            with suppress(ControllerSilent):
                controller = GcsController(port, HEXAPOD, reply_timeout_s=REPLY_TIMEOUT_S)
                assert virtual.snapshot().brake_on
                assert not virtual.snapshot().moving
                controller.release_stop()
                controller.reference()
                port.noisy = True
                return port, controller
        pytest.fail(f"no answer on a quiet line in {ATTEMPTS} attempts")

    port, controller = connect()
    for _ in range(MOVES):
        target = PlatformPose(*(round(noise.uniform(-2.0, 2.0), 3) for _ in range(6)))
        try:
            controller.move(target, 1.0)
        except DeviceError:
            refused += 1
            controller.close()
            port, controller = connect()
            continue
        begun += 1
        assert virtual.snapshot().moving
        now_s[0] += 60.0
        arrived = virtual.snapshot().measured_pose
        assert arrived.as_array() == pytest.approx(target.as_array(), abs=1e-4), (seed, begun)
        port.noisy = False
        try:
            controller.lock()
        except ControllerSilent:
            controller.close()
            port, controller = connect()
        port.noisy = True
    controller.close()
    assert begun > 0
    assert refused > 0


def test_the_noise_is_noise() -> None:
    port = NoisyPort(VirtualController(HEXAPOD, lambda: 0.0), random.Random(0))
    port.noisy = True
    port.write(b"*IDN?\n" * 100)
    assert port.read(10000) != b"".join([VirtualController(HEXAPOD, lambda: 0.0).receive("*IDN?")] * 100)

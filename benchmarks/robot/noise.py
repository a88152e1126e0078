"""One byte in a hundred, or a thousand, wrong on the controller's line; writes docs/benchmarks/robot-noise.md.

Every command is a whole move through the product's driver to the virtual controller. What the line spoils must be
refused; what is begun must be what was asked for, and what is said of the position must be true.
"""

import random
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat

import numpy as np

from benchmarks.common.places import PAGES
from benchmarks.robot.memory_port import MemoryPort
from benchmarks.robot.plans import HEXAPOD, random_target
from services.robot.core.deviation import deviation
from services.robot.core.tuning import SUPERVISION
from services.robot.devices.controller import ControllerSilent
from services.robot.devices.gcs.controller import GcsController
from shared.errors import DeviceError
from simulation.controller.virtual_controller import VirtualController

COMMANDS = 10_000
WRONG_SHARES = (0.01, 0.001)
BLOCK = 250
PROCESSES = 2
FIRST_SEED = 100
REPLY_TIMEOUT_S = 0.02
CONNECTION_ATTEMPTS = 100
WRITTEN_TOLERANCE = 1e-4
LONGEST_MOVE_S = 60.0
REPORT = PAGES / "robot-noise.md"


@dataclass(frozen=True, slots=True)
class NoiseResult:
    """What became of the commands: begun and right, refused with a reason, or wrong (sentences)."""

    commands: int
    right: int
    refused: int
    wrong: tuple[str, ...]
    worst_read_back_mm: float
    worst_read_back_deg: float


class _Line:
    """A driver on a line that can be bad or good."""

    def __init__(self, seed: int, wrong_share: float) -> None:
        self.now_s = 0.0
        self.virtual = VirtualController(HEXAPOD, lambda: self.now_s)
        self._noise = random.Random(seed)
        self._wrong_share = wrong_share
        self._bad = False
        self.driver = self.connected()

    def _carry(self, content: bytes) -> bytes:
        if not self._bad:
            return content
        noise = self._noise
        return bytes(noise.randrange(256) if noise.random() < self._wrong_share else byte for byte in content)

    def connected(self) -> GcsController:
        """Connect anew over a good line, as a person would have seen to it; referenced, stop released."""
        self._bad = False
        for _ in range(CONNECTION_ATTEMPTS):
            try:
                driver = GcsController(
                    MemoryPort(self.virtual, [], self._carry), HEXAPOD, reply_timeout_s=REPLY_TIMEOUT_S
                )
                driver.release_stop()
                driver.reference()
            except ControllerSilent:
                continue  # only a busy machine is silent on a good line: the time-out is short
            self._bad = True
            return driver
        raise TimeoutError(f"no connection in {CONNECTION_ATTEMPTS} attempts; the machine is too busy to measure on")


def run_block(seed: int, wrong_share: float) -> NoiseResult:
    """Ask for `BLOCK` moves one after another on one line."""
    line, source = _Line(seed, wrong_share), random.Random(seed)
    right = refused = 0
    wrong: list[str] = []
    worst = np.zeros(2)
    for number in range(BLOCK):
        target = random_target(source, 2.0)
        before = line.virtual.snapshot().pose
        try:
            line.driver.move(target, 1.0)
        except DeviceError:
            refused += 1
            line.driver.stop_now()  # what the drive does about every such error, before anything else
            line.now_s += LONGEST_MOVE_S
            after = line.virtual.snapshot().pose
            # Refused and stopped means: nothing has moved, whatever time passes.
            if np.abs(after.as_array() - before.as_array()).max() > WRITTEN_TOLERANCE:
                wrong.append(f"seed {seed}, command {number}: refused, but moved to {after}")
            line.driver.close()
            line.driver = line.connected()
            continue
        right += 1
        line.now_s += LONGEST_MOVE_S
        arrived = line.virtual.snapshot().pose
        if np.abs(arrived.as_array() - target.as_array()).max() > WRITTEN_TOLERANCE:
            wrong.append(f"seed {seed}, command {number}: asked for {target}, went to {arrived}")
        try:
            said = line.driver.read().pose
        except DeviceError:
            said = arrived  # a feedback that was refused says nothing wrong
        off = deviation(said, arrived)
        worst = np.maximum(worst, [off.distance_mm, off.angle_deg])
        if off.exceeds(SUPERVISION.read_back):
            wrong.append(f"seed {seed}, command {number}: read back {said}, it stands at {arrived}")
        line.driver.stop_now()
        line.driver.close()
        line.driver = line.connected()
    line.driver.close()
    return NoiseResult(BLOCK, right, refused, tuple(wrong), float(worst[0]), float(worst[1]))


def total_of(blocks: Iterable[NoiseResult]) -> NoiseResult:
    """Sum of blocks."""
    all_blocks = list(blocks)
    return NoiseResult(
        sum(b.commands for b in all_blocks),
        sum(b.right for b in all_blocks),
        sum(b.refused for b in all_blocks),
        tuple(w for b in all_blocks for w in b.wrong),
        max(b.worst_read_back_mm for b in all_blocks),
        max(b.worst_read_back_deg for b in all_blocks),
    )


def main() -> int:
    """Run all blocks, write the report; 0 when nothing went wrong."""
    seeds = range(FIRST_SEED, FIRST_SEED + COMMANDS // BLOCK)
    with ProcessPoolExecutor(PROCESSES) as pool:
        totals = [total_of(pool.map(run_block, seeds, repeat(share))) for share in WRONG_SHARES]
    for sentence in (sentence for total in totals for sentence in total.wrong):
        print(sentence)
    report = _report(totals)
    print(report)
    REPORT.write_text(report)
    return 1 if any(total.wrong for total in totals) else 0


def _report(totals: Sequence[NoiseResult]) -> str:
    rows = "".join(
        f"| {share:.1%} | {t.commands} | {t.right} | {t.refused} | {len(t.wrong)} | {t.worst_read_back_mm:.4f} mm, "
        f"{t.worst_read_back_deg:.4f}° |\n"
        for share, t in zip(WRONG_SHARES, totals, strict=True)
    )
    return (
        "# A noisy line\n\n"
        "Made by `distalock bench robot_noise`: moves through the driver to the virtual controller, some bytes "
        "replaced "
        "by random ones, both ways.\nWrong: moved elsewhere than asked, moved though refused, or read back wrongly "
        "(limits: none; 0.05 mm, 0.05°).\n\n"
        "| wrong bytes | moves asked for | begun, ended at the target | refused, nothing moved | wrong | position read "
        "back against the truth, worst |\n|---|---|---|---|---|---|\n" + rows
    )


if __name__ == "__main__":
    sys.exit(main())

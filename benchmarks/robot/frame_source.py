"""Frames of a fluoroscopy on the bus, as imaging publishes them, in a process of its own, until standard input ends."""

import argparse
import hashlib
import select
import sys
import time
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from shared.bus.keys import Keys
from shared.bus.settings import BusSettings
from shared.bus.tls import TlsFiles
from shared.bus.zenoh_bus import open_bus
from shared.messages.base import encode
from shared.messages.imaging import FrameHeader

FRAME_HZ: Final = 30.0
# Two megabytes of float32, the size of `distalock bench bus`.
SIDE_PX: Final = 720
_IMAGES: Final = 8


def images(seed: int) -> list[bytes]:
    """Some different pictures: a shaded thigh with a nail, and the noise of fluoroscopy."""
    source = np.random.default_rng(seed)
    x = np.linspace(-1.0, 1.0, SIDE_PX)
    shade: NDArray[np.float64] = 0.4 + 0.4 * np.abs(x)[None, :] + 0.05 * x[:, None]
    shade[:, SIDE_PX * 9 // 20 : SIDE_PX * 11 // 20] -= 0.25
    return [(shade + source.normal(0.0, 0.01, shade.shape)).astype("<f4").tobytes() for _ in range(_IMAGES)]


def header(number: int, case: tuple[str | None, int]) -> FrameHeader:
    """One frame of a run, for a case or for none."""
    return FrameHeader(
        sha256=hashlib.sha256(b"%d" % number).hexdigest(),
        sop_instance_uid=f"1.2.3.{number}",
        sequence=number,
        boot_epoch="load",
        received_at_ns=time.time_ns(),
        width_px=SIDE_PX,
        height_px=SIDE_PX,
        bits_stored=12,
        case_id=case[0],
        case_revision=case[1],
        nominal_source_to_detector_mm=1000.0,
        nominal_pixel_mm=0.3,
        run_interval_s=None if number == 1 else 1.0 / FRAME_HZ,
        store_id="load",
        age_s=0.0,
    )


def main() -> int:
    """Exit code 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--router", required=True)
    parser.add_argument("--state", type=Path, required=True)
    parser.add_argument("--case", help="its id; without it the frames belong to none")
    parser.add_argument("--revision", type=int, default=0)
    parser.add_argument("--first", type=int, default=1)
    given = parser.parse_args()
    pictures = images(1)
    with open_bus(BusSettings(given.router, tls=TlsFiles.in_state(given.state, "imaging"))) as bus:
        frames = bus.publisher(Keys("or1").frame)
        print("ready", flush=True)
        number, due_s = given.first, time.monotonic()
        while not select.select([sys.stdin], [], [], max(due_s - time.monotonic(), 0.0))[0]:
            frames.put(pictures[number % _IMAGES], encode(header(number, (given.case, given.revision))))
            number += 1
            due_s = max(due_s, time.monotonic() - 1.0) + 1.0 / FRAME_HZ
    print(number)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Hexapod: inverse then forward kinematics over the workspace, and how fast the inverse is beside plain NumPy."""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.common.places import PAGES
from shared.geometry.hexapod import HexapodPart, PlatformPose
from shared.geometry.hexapod_forward import poses_from_leg_lengths
from shared.geometry.hexapod_inverse import leg_lengths_of_many_mm
from shared.geometry.hexapod_limits import within_limits
from shared.parts.hexapod_file import default_hexapod

SEED = 20240501
POSES = 100_000
TIMED_POSES = 500_000
REPETITIONS = 7
LIMIT_MM = LIMIT_RAD = 1e-9
LEAST_PER_S = 1e6
REPORT = PAGES / "robot-kinematics.md"
_SPREAD = np.array([16.0, 16.0, 9.0, 16.0, 10.0, 25.0])

Inverse = Callable[[HexapodPart, NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """Worst difference between poses and what forward kinematics makes of their leg lengths, started at zero."""

    poses: int
    worst_mm: float
    worst_rad: float


@dataclass(frozen=True, slots=True)
class Speed:
    """Inverse solutions per second on one core: the best of several repetitions, ours and plain NumPy in turn."""

    ours_per_s: float
    plain_per_s: float


def main() -> int:
    """Measure, write the report; 0 when the limits hold."""
    hexapod = default_hexapod()
    trip = round_trip(hexapod, SEED, POSES)
    speed = inverse_speed(hexapod, SEED, TIMED_POSES)
    report = _report(trip, speed)
    print(report)
    REPORT.write_text(report)
    exact = trip.worst_mm < LIMIT_MM and trip.worst_rad < LIMIT_RAD
    return 0 if exact and speed.ours_per_s >= LEAST_PER_S else 1


def poses_in_the_workspace(hexapod: HexapodPart, seed: int, count: int) -> NDArray[np.float64]:
    """Random poses within all limits, X Y Z (mm) U V W (degrees), shape (count, 6)."""
    rng = np.random.default_rng(seed)
    found: list[NDArray[np.float64]] = []
    while sum(map(len, found)) < count:
        tried = rng.uniform(-1.0, 1.0, (50_000, 6)) * _SPREAD
        found.append(tried[within_limits(hexapod, tried, hexapod.pivot_mm)])
    return np.concatenate(found)[:count]


def round_trip(hexapod: HexapodPart, seed: int, count: int) -> RoundTrip:
    """Inverse, then forward from the zero pose, and the worst difference."""
    poses = poses_in_the_workspace(hexapod, seed, count)
    lengths = leg_lengths_of_many_mm(hexapod, poses, hexapod.pivot_mm)
    found = poses_from_leg_lengths(hexapod, lengths, hexapod.pivot_mm, PlatformPose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    off = np.abs(found - poses)
    return RoundTrip(len(poses), float(off[:, :3].max()), float(np.radians(off[:, 3:].max())))


def plain_numpy(hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """The peer: the textbook's formula with whole arrays, as anybody would write it first."""
    rotations = Rotation.from_euler("XYZ", poses[:, 3:], degrees=True).as_matrix()
    arms = np.einsum("nij,kj->nki", rotations, hexapod.top_joints_mm - pivot_mm)
    centres = poses[:, :3] + pivot_mm + np.array([0.0, 0.0, hexapod.zero_height_mm])
    return np.asarray(np.linalg.norm(centres[:, None] + arms - hexapod.base_joints_mm, axis=-1))


def inverse_speed(hexapod: HexapodPart, seed: int, count: int) -> Speed:
    """Time ours and the peer in turn, in the same process."""
    poses = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 6)) * _SPREAD
    best = {leg_lengths_of_many_mm: np.inf, plain_numpy: np.inf}
    for _ in range(REPETITIONS):
        for solve in best:
            best[solve] = min(best[solve], _seconds(solve, hexapod, poses))
    return Speed(count / best[leg_lengths_of_many_mm], count / best[plain_numpy])


def _seconds(solve: Inverse, hexapod: HexapodPart, poses: NDArray[np.float64]) -> float:
    begun = time.perf_counter()
    solve(hexapod, poses, hexapod.pivot_mm)
    return time.perf_counter() - begun


def _report(trip: RoundTrip, speed: Speed) -> str:
    return (
        "# Hexapod kinematics\n\n"
        "Made by `distalock bench hexapod_kinematics`, with `OMP_NUM_THREADS=1`.\n\n"
        "| what | measured | limit |\n|---|---|---|\n"
        f"| inverse then forward, {trip.poses} poses of the workspace, worst | {trip.worst_mm:.1e} mm, "
        f"{trip.worst_rad:.1e} rad | {LIMIT_MM:g} mm, {LIMIT_RAD:g} rad |\n"
        f"| inverse solutions on one core | {speed.ours_per_s / 1e6:.2f}·10⁶/s | {LEAST_PER_S / 1e6:g}·10⁶/s |\n"
        f"| plain NumPy, same run | {speed.plain_per_s / 1e6:.2f}·10⁶/s | |\n"
        f"| ratio | {speed.ours_per_s / speed.plain_per_s:.1f} | |\n"
    )


if __name__ == "__main__":
    sys.exit(main())

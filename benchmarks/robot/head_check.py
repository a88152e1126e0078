"""Which mistakes with the head are noticed from the first move, and how often the check is wrong; a page under docs.

In numbers: first moves as random rooms need them, seen with errors as images have them, on a mount that yields.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from benchmarks.common.places import PAGES
from distalock.guide_calibration.noise import image_covariance
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.head_check import MotionView, check_motion
from shared.geometry.frames import Guide, Nail, Ring, RobotBase, RobotTop
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top, platform_pose
from shared.geometry.transform import Transform
from simulation.scenario.files import merged_ranges
from simulation.scenario.placement_sampling import correcting_pose
from simulation.scenario.sampling import scenario_of_seed
from simulation.scenario.values import MountYield
from simulation.world.mount import yielded_base

FIRST_SEED, ROOMS = 5000, 300
HEAD_SD_MM, HEAD_SD_DEG = 0.7, 0.7
MOUNT = MountYield(translation_n_per_mm=100.0, rotation_nm_per_deg=4.0, tissue_n_per_mm=1.5)
# Of the nail in one image: tilts, turn (degrees), place across and along the beam (mm).
NAIL_SD = np.array([*np.radians([0.15, 0.15, 0.05]), 0.03, 0.03, 0.3])
SOURCE_SD_MM = np.array([0.03, 0.03, 0.4])
C_ARM_TURNED_DEG = (0.0, 3.0)
TURN_BINS_DEG = (0.0, 2.0, 4.0, 6.0, 20.0)
REPORT = PAGES / "robot-head.md"


@dataclass(frozen=True, slots=True)
class Mistake:
    """What is wrong with the head: its extension, and how the guide is on it."""

    name: str
    extension_mm: float = 0.0
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)


TURNED_ROUND = Mistake("guide turned by 180° about the drilling axis", turn_deg=(0.0, 0.0, 180.0))
MISTAKES = (
    Mistake("none"),
    Mistake("extension 10 mm more than entered", 10.0),
    Mistake("extension 10 mm less than entered", -10.0),
    TURNED_ROUND,
    Mistake("guide turned by 90° about the drilling axis", turn_deg=(0.0, 0.0, 90.0)),
    Mistake("guide upside down", turn_deg=(180.0, 0.0, 0.0)),
)


@dataclass(frozen=True, slots=True)
class HeadResult:
    """One first move: how far it turned, and what was said (a code, or nothing)."""

    mistake: Mistake
    turn_deg: float
    said: str


@cache
def first_move(seed: int) -> tuple[HexapodPart, float, Transform[Guide, Guide]] | None:
    """The robot, its head's extension and the move that a room needs; None when the robot cannot make it."""
    scenario = scenario_of_seed(seed)
    hexapod = scenario.parts.hexapod
    head = hexapod.top_from_guide(scenario.head_extension_mm)
    target = correcting_pose(merged_ranges({}).placement, scenario.parts, head, scenario.placement)
    if target is None:
        return None
    home, there = (base_from_top(hexapod, p, hexapod.pivot_mm) @ head for p in (hexapod.home_pose, target))
    return hexapod, scenario.head_extension_mm, home.inverse() @ there


def run_room(seed: int, mistake: Mistake, c_arm_turned_deg: float) -> HeadResult | None:
    """The first move of a room, seen in an image before and one after."""
    room = first_move(seed)
    if room is None:
        return None
    hexapod, true_extension_mm, move = room
    rng = np.random.default_rng([seed, 77])
    entered_mm = float(np.clip(true_extension_mm - mistake.extension_mm, 40.0, 80.0))
    if true_extension_mm - entered_mm != mistake.extension_mm:
        return None
    off: Transform[Guide, Guide] = Transform.from_rotvec(
        np.radians(HEAD_SD_DEG) * rng.normal(size=3), HEAD_SD_MM * rng.normal(size=3)
    )
    on: Transform[Guide, Guide] = Transform.from_rotvec(np.radians(mistake.turn_deg), np.zeros(3))
    really = hexapod.top_from_guide(true_extension_mm) @ on @ off
    before, after = _views(hexapod, entered_mm, move, really, c_arm_turned_deg, rng)
    refused = check_motion(hexapod, entered_mm, before, after)
    turn_deg = float(np.degrees(np.linalg.norm(move.rotation_vector_rad)))
    return HeadResult(mistake, turn_deg, "" if refused is None else refused.code.value)


def _views(
    hexapod: HexapodPart,
    entered_mm: float,
    move: Transform[Guide, Guide],
    really: Transform[RobotTop, Guide],
    c_arm_turned_deg: float,
    rng: np.random.Generator,
) -> Iterator[MotionView]:
    """Two images: the planner commands what moves the guide, held as entered, by `move`; the guide goes elsewhere."""
    entered = hexapod.top_from_guide(entered_mm)
    home = base_from_top(hexapod, hexapod.home_pose, hexapod.pivot_mm)
    target = platform_pose(hexapod, home @ entered @ move @ entered.inverse(), hexapod.pivot_mm)
    world: Transform[Ring, RobotBase] = Transform.from_rotvec([0.1, 0.05, rng.uniform(-3, 3)], [20.0, -10.0, -330.0])
    nail: Transform[Guide, Nail] = Transform.from_rotvec([0.05, -0.03, 0.02], [1.0, 2.0, 105.0])
    ring_from_nail = world @ home @ really @ nail
    for pose, turned_deg in ((hexapod.home_pose, 0.0), (target, c_arm_turned_deg)):
        held = base_from_top(hexapod, pose, hexapod.pivot_mm) @ really
        c_arm: Transform[Ring, Ring] = Transform.from_rotvec(np.radians([turned_deg, 0.0, 0.0]), np.zeros(3))
        guide = c_arm @ world @ yielded_base(MOUNT, home @ really, held) @ held
        yield _view(pose, guide, c_arm @ ring_from_nail, rng)


def _view(
    pose: PlatformPose, guide: Transform[Ring, Guide], nail: Transform[Ring, Nail], rng: np.random.Generator
) -> MotionView:
    guide_covariance = image_covariance(guide.rotation)
    nail_covariance = np.diag(NAIL_SD**2)
    return MotionView(
        pose,
        PoseEstimate.of(guide.moved(np.linalg.cholesky(guide_covariance) @ rng.normal(size=6)), guide_covariance),
        PoseEstimate.of(nail.moved(NAIL_SD * rng.normal(size=6)), nail_covariance),
        np.array([0.0, 0.0, -1000.0]) + SOURCE_SD_MM * rng.normal(size=3),
        np.diag(SOURCE_SD_MM**2),
    )


def main() -> int:
    """Measure and write the report; 0 when no right head was refused and no guide turned by 180° passed."""
    results = {turned: [r for m in MISTAKES for r in rooms_with(m, turned)] for turned in C_ARM_TURNED_DEG}
    report = _report(results)
    print(report)
    REPORT.write_text(report)
    everything = [r for some in results.values() for r in some]
    refused_rightly = all(r.said for r in everything if r.mistake is TURNED_ROUND)
    return 0 if refused_rightly and not any(r.said for r in everything if r.mistake is MISTAKES[0]) else 1


def rooms_with(mistake: Mistake, c_arm_turned_deg: float) -> list[HeadResult]:
    """All rooms in which this mistake can be made."""
    seeds = range(FIRST_SEED, FIRST_SEED + ROOMS)
    results = (run_room(seed, mistake, c_arm_turned_deg) for seed in seeds)
    return [result for result in results if result is not None]


def _report(results: dict[float, list[HeadResult]]) -> str:
    bins = list(pairwise(TURN_BINS_DEG))
    tables = ""
    for turned_deg, mine in results.items():
        still = "stood still" if turned_deg == 0.0 else f"was turned by {turned_deg:g}°"
        tables += (
            f"\n## The C-arm {still} between the images\n\n"
            f"| mistake | {' | '.join(f'move turns by {low:g} to {high:g}°' for low, high in bins)} |\n"
            f"|---|{'---|' * len(bins)}\n"
        )
        for mistake in MISTAKES:
            cells = (
                _cell([r for r in mine if r.mistake is mistake and low <= r.turn_deg < high]) for low, high in bins
            )
            tables += f"| {mistake.name} | {' | '.join(cells)} |\n"
    return (
        "# Is the guide held as the case says? The first move\n\n"
        "Made by `distalock bench robot_head_check`: refused / moves. Moves as random rooms need them, seen in an "
        "image before and one\nafter, with errors as images have them, in numbers. All heads are wrong by "
        f"{HEAD_SD_MM:g} mm and {HEAD_SD_DEG:g}° per axis besides; the mount gives way\nby "
        f"{MOUNT.translation_n_per_mm:g} N/mm and {MOUNT.rotation_nm_per_deg:g} Nm/° while tissue pushes back with "
        f"{MOUNT.tissue_n_per_mm:g} N/mm.\n"
        f"{tables}"
    )


def _cell(results: Sequence[HeadResult]) -> str:
    return f"{sum(bool(r.said) for r in results)} / {len(results)}"


if __name__ == "__main__":
    sys.exit(main())

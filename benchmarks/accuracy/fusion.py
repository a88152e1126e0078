"""Several images of one set-up: what one, two and three say of the axes; writes docs/benchmarks/fusion.md.

Every seed is a patient with parts of its own, seen four times while the guide stays where it is: from near the holes'
axis (A), again from there (A'), from the other side of the axis (B), and from across (C).
"""

import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.baselines.fusion_peers import (
    Joining,
    as_independent,
    as_poses_alone,
    as_shipped,
    by_covariance_intersection,
)
from benchmarks.common.places import PAGES
from benchmarks.common.statistics import root_mean_square
from benchmarks.scenes.set_ups import SetUp
from services.registration.core.drill_clearance import angle_deg, axis_offset_mm
from services.registration.core.estimation.joint import fuse
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.fusion import Estimates, disagreement
from services.registration.core.guide_from_nail import guide_from_nail_of
from services.registration.core.hole_axes import HoleEstimate, holes_at
from services.registration.core.localise import Parts
from services.registration.core.tuning import SHARED_ERRORS
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform

FIRST_SEED, SET_UPS, PROCESSES = 7000, 64, 2
REPORT = PAGES / "fusion.md"
COMBINATIONS = {
    "one image (A)": (0,),
    "two from one direction (A, A')": (0, 1),
    "two from two directions (A, B)": (0, 2),
    "three directions (A, B, C)": (0, 2, 3),
}
_PAIRS = {"A, A'": (0, 1), "A, B": (0, 2)}
_WAYS = {
    "as shipped": as_shipped,
    "poses alone, without the nail's shape": as_poses_alone,
    "the same, covariance of independent images": as_independent,
    "covariance intersection": by_covariance_intersection,
}
_SHIFTS_MM = (0.2, 0.4, 0.7, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class SeenSetUp:
    """What four images of one set-up said: None where the image was refused.

    Attributes
    ----------
    camera_from_nail
        In the first image that was not refused.
    """

    seed: int
    parts: Parts
    truth: Transform[Guide, Nail]
    estimates: tuple[PoseEstimate[Guide, Nail] | None, ...]
    camera_from_nail: Transform[Camera, Nail]


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of the worse hole, and both over their predictions (rms over the holes)."""

    entry_mm: float
    axis_deg: float
    depth_mm: float
    normalised_entry: float
    normalised_axis: float


def main() -> int:
    """See all set-ups and write the report; 0 when no good images were called contradictory."""
    seeds = range(FIRST_SEED, FIRST_SEED + SET_UPS)
    with ProcessPoolExecutor(PROCESSES) as pool:
        seen = [one for one in pool.map(seen_set_up, seeds) if one is not None]
    text = report(seen)
    REPORT.parent.mkdir(parents=True, exist_ok=True)
    REPORT.write_text(text)
    print(text)
    return int(any(refused(one, images) for one in seen for images in COMBINATIONS.values()))


def directions_deg(seed: int) -> NDArray[np.float64]:
    """From where the four images are taken: lean of the beam about the nail's x and y axes, shape (4, 2)."""
    generator = np.random.default_rng([seed, 77])
    azimuth, lean = generator.uniform(0.0, 2.0 * np.pi), generator.uniform(1.0, 4.0)
    generator.uniform(size=2)
    first = lean * np.array([np.cos(azimuth), np.sin(azimuth)])
    opposite = -first / lean * generator.uniform(4.0, 7.0)
    across = np.array([-first[1], first[0]]) / lean * generator.uniform(3.0, 6.0)
    return np.stack([first, first, opposite, across])


def seen_set_up(seed: int) -> SeenSetUp | None:
    """Take and localise the four images of a seed; None when all were refused."""
    set_up = SetUp.of_seed(seed)
    estimates: list[PoseEstimate[Guide, Nail] | None] = []
    poses = []
    for shot_number, lean in enumerate(directions_deg(seed)):
        image = set_up.turned(*lean).seen(shot_number)
        result, calibration, parts = image.result, image.calibration, set_up.parts
        estimates.append(None)
        if image.reasons or calibration is None or result is None or result.guide is None or result.nail is None:
            continue
        estimates[-1] = guide_from_nail_of(calibration, parts.guide, parts.nail, result.guide, result.nail)
        poses.append(result.nail.camera_from_nail)
        truth = image.shot.world.guide_from_nail
    print(f"{seed}: {sum(one is not None for one in estimates)} of 4 images accepted", flush=True)
    if not poses:
        return None
    return SeenSetUp(seed, set_up.parts, truth, tuple(estimates), poses[0])


def chosen(seen: SeenSetUp, images: tuple[int, ...]) -> Estimates | None:
    """The estimates from some images; None when one of them was refused."""
    found = tuple(one for k in images if (one := seen.estimates[k]) is not None)
    return found if len(found) == len(images) else None


def refused(seen: SeenSetUp, images: tuple[int, ...]) -> bool:
    """Whether images of one set-up are wrongly said to contradict one another."""
    estimates = chosen(seen, images)
    return estimates is not None and _disagree(seen, estimates)


def errors_of(seen: SeenSetUp, images: tuple[int, ...], joining: Joining = as_shipped) -> Errors | None:
    """What some images together make of the axes."""
    estimates = chosen(seen, images)
    if estimates is None:
        return None
    joint = joining(estimates).pose
    nail, drill_mm = seen.parts.nail, seen.parts.drill_diameter_mm
    found = holes_at(nail, drill_mm, joint.mean, np.pad(joint.covariance, (0, 2)), seen.camera_from_nail)
    true = holes_at(nail, drill_mm, seen.truth, None, seen.camera_from_nail)
    rows = np.array([_hole_errors(a, b) for a, b in zip(found, true, strict=True)])
    entry_mm, axis_deg, depth_mm = (float(v) for v in rows[:, :3].max(axis=0))
    return Errors(entry_mm, axis_deg, depth_mm, root_mean_square(rows[:, 3]), root_mean_square(rows[:, 4]))


def _hole_errors(found: HoleEstimate, true: HoleEstimate) -> tuple[float, float, float, float, float]:
    offset = axis_offset_mm(true.axis_guide, found.axis_guide, true.entry_guide_mm, true.exit_guide_mm)
    entry_mm, axis_deg = float(np.linalg.norm(offset[:2])), angle_deg(true.axis_guide, found.axis_guide)
    depth_mm = abs(float((found.entry_guide_mm - true.entry_guide_mm) @ true.axis_guide.direction))
    assert found.offset is not None
    return entry_mm, axis_deg, depth_mm, entry_mm / found.offset.entry_sd_mm, axis_deg / found.offset.axis_sd_deg


def _disagree(seen: SeenSetUp, estimates: Estimates) -> bool:
    names = tuple(str(k + 1) for k in range(len(estimates)))
    return disagreement(fuse(estimates), estimates, names, seen.parts, seen.camera_from_nail) is not None


def report(seen: Sequence[SeenSetUp]) -> str:
    """The page."""
    rows = [_row(seen, name, images) for name, images in COMBINATIONS.items()]
    return (
        "# Several images of one set-up\n\n"
        f"Made by `distalock bench fusion`: {len(seen)} set-ups of the virtual operating room from seed {FIRST_SEED}, "
        "each with its own ball patterns and nail, seen four times: from near the holes' axis (A), again from there "
        "with new noise (A'), from 5-11° away on the other side of the axis (B), and from 3-7° away across (C). "
        "Errors: the worse hole's, median / 95 % / worst. The images come from this project's own renderer.\n\n"
        "| images | set-ups | entry mm | axis ° | depth mm | normalised entry, axis | wrongly called contradictory |\n"
        "|---|---|---|---|---|---|---|\n"
        + "\n".join(rows)
        + "\n\n"
        + _correlations(seen)
        + _peers(seen)
        + _moved_guides(seen)
    )


def _row(seen: Sequence[SeenSetUp], name: str, images: tuple[int, ...]) -> str:
    errors = [one for s in seen if (one := errors_of(s, images)) is not None]
    wrong = sum(refused(s, images) for s in seen)
    entry, axis = _quantiles([e.entry_mm for e in errors]), _quantiles([e.axis_deg for e in errors])
    return (
        f"| {name} | {len(errors)} | {entry} | {axis} "
        f"| {_quantiles([e.depth_mm for e in errors])} | {root_mean_square(e.normalised_entry for e in errors):.2f}, "
        f"{root_mean_square(e.normalised_axis for e in errors):.2f} | {wrong} |"
    )


def _quantiles(values: Sequence[float]) -> str:
    if not values:
        return "-"
    return " / ".join(f"{v:.3f}" for v in (np.median(values), np.percentile(values, 95), np.max(values)))


def _correlations(seen: Sequence[SeenSetUp]) -> str:
    """Measured correlation of two images' errors, for each way the nail can move in the guide's frame."""
    rows = []
    for name, pair in (("A and A' (0°)", (0, 1)), ("A and B (5-11°)", (0, 2)), ("A and C (3-7°)", (0, 3))):
        errors = [_normalised(s, e) for s in seen if (e := chosen(s, pair)) is not None]
        first, second = np.array([a for a, _ in errors]), np.array([b for _, b in errors])
        r = (first * second).mean(axis=0) / np.sqrt((first**2).mean(axis=0) * (second**2).mean(axis=0))
        rows.append(f"| {name} | " + " | ".join(f"{v:.2f}" for v in r) + " |")
    shared = SHARED_ERRORS
    return (
        "## What the images share\n\n"
        "Correlation of the errors of two images, each over its predicted standard uncertainty (rotation about the "
        f"nail's axes, place along them). The fusion takes {shared.from_one_direction} at 0° for what comes with "
        f"an image, falling with the angle (standard deviation {shared.within_deg:g}°), and {shared.of_the_model} for "
        "the model's own errors.\n\n"
        "| images | about x | about y | about z | x | y | z |\n|---|---|---|---|---|---|---|\n"
        + "\n".join(rows)
        + "\n\n"
    )


def _peers(seen: Sequence[SeenSetUp]) -> str:
    """The same images joined in other ways."""
    rows = []
    for name, joining in _WAYS.items():
        for pair in ("A, A'", "A, B"):
            errors = [e for s in seen if (e := errors_of(s, _PAIRS[pair], joining)) is not None]
            entry, axis = _quantiles([e.entry_mm for e in errors]), _quantiles([e.axis_deg for e in errors])
            rated = [(e.normalised_entry, e.normalised_axis) for e in errors]
            normalised = [root_mean_square(v) for v in zip(*rated, strict=True)]
            rows.append(f"| {name} | {pair} | {entry} | {axis} | {normalised[0]:.2f}, {normalised[1]:.2f} |")
    return (
        "## Other ways to join them\n\n"
        "| | images | entry mm | axis ° | normalised entry, axis |\n|---|---|---|---|---|\n" + "\n".join(rows) + "\n\n"
    )


def _normalised(seen: SeenSetUp, estimates: Estimates) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    first, second = (seen.truth.motion_to(one.mean) / np.sqrt(np.diag(one.covariance)) for one in estimates)
    return first, second


def _moved_guides(seen: Sequence[SeenSetUp]) -> str:
    """How often a guide that moved across the holes before the last image is noticed."""
    rows = []
    for shift_mm in _SHIFTS_MM:
        cells = []
        for images in ((0, 2), (0, 2, 3)):
            told = [_disagree(s, _shifted(s, e, shift_mm)) for s in seen if (e := chosen(s, images)) is not None]
            cells.append(f"{sum(told)} of {len(told)}")
        rows.append(f"| {shift_mm:g} | {cells[0]} | {cells[1]} |")
    return (
        "## A guide that moved before the last image\n\n"
        "The last image's pose is moved across the holes by as much, in a direction of the seed's; how often that is "
        "refused.\n\n| moved by mm | two images (A, B) | three (A, B, C) |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    )


def _shifted(seen: SeenSetUp, estimates: Estimates, shift_mm: float) -> Estimates:
    azimuth = float(np.random.default_rng([seen.seed, 78]).uniform(0.0, 2.0 * np.pi))
    motion = np.array([0.0, 0.0, 0.0, shift_mm * np.cos(azimuth), shift_mm * np.sin(azimuth), 0.0])
    last = replace(estimates[-1], mean=estimates[-1].mean.moved(motion))
    return (*estimates[:-1], last)


if __name__ == "__main__":
    sys.exit(main())

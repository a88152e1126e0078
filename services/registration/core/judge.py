"""The verdict: may this localisation move a robot? And if not, why, in words that help."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from services.registration.core.alignment import CArmTurn
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.nail.judgement import LEAST_MARGIN_OF_ONE_HOLE
from services.registration.core.nail_estimate import NailEstimate
from shared.errors import Reason, ReasonCode
from shared.figures import figure
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Guide, Nail
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform

LARGEST_ENTRY_BOUND_MM = 1.0
LARGEST_AXIS_BOUND_DEG = 1.5
LEAST_CHANCE = 0.99
LARGEST_TILT_DEG = 14.0
LARGEST_DISTORTION_SD_PX = 0.5
LARGEST_RADIUS_EXCESS_MM = 0.12
LARGEST_STRUCTURE = 2.0


def judge(
    calibration: CArmCalibration,
    guide: GuidePart,
    nail: NailPart,
    guide_from_nail: Transform[Guide, Nail],
    estimate: NailEstimate,
    holes: tuple[HoleEstimate, ...],
    correction: CArmTurn,
) -> tuple[Reason, ...]:
    """Reasons against a localisation in which ring, guide and nail were all found; none means accepted."""
    return (
        *_extrapolated(calibration, nail, estimate),
        *_exchanged(guide, nail, guide_from_nail),
        *_alone(nail, estimate),
        *_unexplained(estimate),
        *(reason for hole in holes for reason in _tilted(hole, correction)),
        *uncertain_holes(holes),
    )


def uncertain_holes(holes: tuple[HoleEstimate, ...]) -> tuple[Reason, ...]:
    """Reasons against holes that are not known well enough, whether from one image or from several."""
    return tuple(reason for hole in holes for reason in _uncertain(hole))


def _extrapolated(calibration: CArmCalibration, nail: NailPart, estimate: NailEstimate) -> Iterator[Reason]:
    for hole in nail.holes:
        place = calibration.image_from_camera(estimate.camera_from_nail @ hole.axis.point_mm)
        deviation = float(calibration.distortion.standard_deviation_at(place))
        if not deviation <= LARGEST_DISTORTION_SD_PX:
            yield Reason(
                ReasonCode.CALIBRATION_EXTRAPOLATED,
                f"nail hole '{hole.id}' lies at ({place[0]:.0f}, {place[1]:.0f}) px, where the ring's balls leave the "
                f"image's distortion uncertain by {figure(deviation, LARGEST_DISTORTION_SD_PX, 2)} px (limit "
                f"{LARGEST_DISTORTION_SD_PX}); move the C-arm until the holes are nearer to the image's centre and "
                "take one more image",
            )


def _exchanged(guide: GuidePart, nail: NailPart, guide_from_nail: Transform[Guide, Nail]) -> Iterator[Reason]:
    """Holes of the same id belong together: those of the nail must follow one another as those of the guide do."""
    in_guide = {hole.id: hole.axis.point_mm for hole in guide.holes}
    in_nail = {hole.id: guide_from_nail @ hole.axis.point_mm for hole in nail.holes if hole.id in in_guide}
    for first, second in pairwise(in_nail):
        by_guide, by_nail = in_guide[second] - in_guide[first], in_nail[second] - in_nail[first]
        if float(by_guide @ by_nail) < 0.0:
            yield Reason(
                ReasonCode.NAIL_MODEL_MISMATCH,
                f"from hole '{first}' to hole '{second}' the nail's file goes {by_nail[0]:+.1f} mm along the guide's x "
                f"axis and the guide's file {by_guide[0]:+.1f} mm (limit: the same direction); check the holes' ids in "
                "both files and that the guide's +x points to the nail's tip",
            )


def _alone(nail: NailPart, estimate: NailEstimate) -> Iterator[Reason]:
    """With one hole there is no spacing to tell the depth, and one opening to tell the tilt."""
    margin = estimate.mirror_margin
    if len(nail.holes) > 1 or margin is None or margin >= LEAST_MARGIN_OF_ONE_HOLE:
        return
    yield Reason(
        ReasonCode.MIRROR_AMBIGUOUS,
        "the nail has one hole, and another tilt explains the image nearly as well: logarithm of the likelihood ratio "
        f"{figure(margin, LEAST_MARGIN_OF_ONE_HOLE, 1)} (limit {LEAST_MARGIN_OF_ONE_HOLE:.0f}); turn the C-arm by 5° "
        "and take one more image",
    )


def _unexplained(estimate: NailEstimate) -> Iterator[Reason]:
    """Something over a hole that the model does not know (a wire, an instrument) shows in radii and residual first."""
    misfit = estimate.misfit
    if misfit is None:
        return
    most_mm = 2.0 * LARGEST_RADIUS_EXCESS_MM
    measured = [
        f"the {what} {figure(2.0 * excess_mm, most_mm, 2, '+')} mm in diameter against the nail's file (limit "
        f"{most_mm:.2f} mm)"
        for what, excess_mm in (
            ("holes measure", misfit.hole_radius_excess_mm),
            ("nail measures", misfit.nail_radius_excess_mm),
        )
        if not abs(excess_mm) <= LARGEST_RADIUS_EXCESS_MM
    ]
    if not misfit.structure <= LARGEST_STRUCTURE:
        measured.append(
            f"{figure(misfit.structure, LARGEST_STRUCTURE, 1)} times the noise is left unexplained at the edges of "
            f"nail and holes (limit {LARGEST_STRUCTURE:g})"
        )
    if measured:
        yield Reason(
            ReasonCode.NAIL_MODEL_MISMATCH,
            f"{', and '.join(measured)}; remove wires and instruments from in front of the holes, check that the file "
            "is that of the implanted nail, and take one more image",
        )


def _tilted(hole: HoleEstimate, correction: CArmTurn) -> Iterator[Reason]:
    if hole.tilt_to_ray_deg > LARGEST_TILT_DEG:
        yield Reason(
            ReasonCode.TILT_TOO_LARGE,
            f"the axis of nail hole '{hole.id}' is tilted by {figure(hole.tilt_to_ray_deg, LARGEST_TILT_DEG, 1)}° "
            f"against the beam (limit {LARGEST_TILT_DEG:g}°); turn the C-arm by {correction.about_x_deg:+.1f}° about "
            f"the image's x axis and {correction.about_y_deg:+.1f}° about its y axis and take one more image",
        )


def _uncertain(hole: HoleEstimate) -> Iterator[Reason]:
    if hole.offset is None:
        yield Reason(
            ReasonCode.UNCERTAINTY_TOO_LARGE,
            f"the fronto-parallel method does not know how far off the axis of hole '{hole.id}' is, and errors above "
            f"the limit of {LARGEST_AXIS_BOUND_DEG:g}° are usual with it; localise with the model method before "
            "anything is moved",
        )
        return
    bounds = (hole.offset.entry_bound_mm, hole.offset.axis_bound_deg)
    chance = hole.offset.chance_to_pass(hole.diameter_mm)
    within = bounds[0] <= LARGEST_ENTRY_BOUND_MM and bounds[1] <= LARGEST_AXIS_BOUND_DEG
    if not (within and np.isfinite(chance) and chance >= LEAST_CHANCE):
        yield Reason(
            ReasonCode.UNCERTAINTY_TOO_LARGE,
            f"the axis of nail hole '{hole.id}' is known to {figure(bounds[0], LARGEST_ENTRY_BOUND_MM, 2)} mm and "
            f"{figure(bounds[1], LARGEST_AXIS_BOUND_DEG, 2)}° with 95 % confidence (limits {LARGEST_ENTRY_BOUND_MM:g} "
            f"mm and {LARGEST_AXIS_BOUND_DEG:g}°), and a 4 mm drill would pass it with a chance of "
            f"{figure(chance, LEAST_CHANCE, 3)} (limit {LEAST_CHANCE}); take one more image with more dose, the hole "
            "in the middle of the image and no balls over it",
        )

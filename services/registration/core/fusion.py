"""Several localised images of one set-up: which count, their joint estimate, and whether they agree.

The guide must be in the same place on the bone in all of them; the C-arm may have moved. Depth is weak in one image and
seen from another direction, so each image's estimate is weighted with its full covariance (`estimation/joint.py`). If
the images contradict one another, the explanation names the odd image, or when the guide moved.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import IMAGES_CHI_SQUARE, chi_square_limit
from services.registration.core.acceptance.image import uncertainty_reasons
from services.registration.core.drill_clearance import angle_deg, axis_offset_mm
from services.registration.core.estimation.joint import JointEstimate, fuse, leave_one_out
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.guide_from_nail import guide_from_nail_of
from services.registration.core.hole_axes import HoleEstimate, holes_at
from services.registration.core.localise import LocalisationResult, Parts, departures_of
from services.registration.core.nail.parameters import SHAPE_PARAMETERS, Parameter, priors
from services.registration.core.tuning import NAIL_PRIORS
from shared.errors import Reason, ReasonCode
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform

Estimates = tuple[PoseEstimate[Guide, Nail], ...]

# A lone image may not be certain enough: together with others it may be. All other reasons make it useless.
_USABLE_THOUGH = frozenset({ReasonCode.UNCERTAINTY_TOO_LARGE})
# Chi-square is a parabola in a shift of all images; any step finds it.
_STEP_MM = 1.0
# Guard: nobody builds a guide further off than this share; images from nearly one direction would fit any move.
_LARGEST_EXCESS = 0.1
# Radii that separate one nail from another, by the names that people give them.
_RADII = {
    Parameter.HOLE_RADIUS_EXCESS_MM: "the holes' radius",
    Parameter.NAIL_RADIUS_EXCESS_MM: "the nail's radius",
}


@dataclass(frozen=True, slots=True, eq=False)
class ImageResult:
    """One image with what was found in it."""

    name: str  # what it is called in sentences for people
    pixels: NDArray[np.float32]  # as received, darker is denser, shape (rows, columns)
    calibration: CArmCalibration | None  # None when the ring was not found; then nothing else was
    result: LocalisationResult


@dataclass(frozen=True, slots=True)
class ImageShare:
    """What became of one image."""

    used: bool  # whether it contributes to the joint estimate
    # By how much the joint chi-square grew through it; about 9 when all is well. None when it was not used, or alone.
    chi_square: float | None


@dataclass(frozen=True, slots=True, eq=False)
class FusedLocalisation:
    """The joint localisation of several images."""

    # As if from one image: what belongs to an image (guide and nail in the camera's frame, tilts, the C-arm's
    # correction) is that of image `shown`, the newest that was used; that one's, refused, when the images disagree
    result: LocalisationResult
    shown: int  # its index; the last image's when none was used
    shares: tuple[ImageShare, ...]
    # How well the images agree; zero for fewer than two
    chi_square: float
    chi_square_limit: float
    degrees_of_freedom: int


def fuse_localisations(images: tuple[ImageResult, ...], parts: Parts) -> FusedLocalisation | None:
    """Join the images of one set-up, in the order in which they were taken; None when no image can be used.

    Used is every image that was accepted, or rejected for nothing but its own uncertainty.
    """
    estimates = {k: one for k, image in enumerate(images) if (one := usable_estimate(image, parts)) is not None}
    if not estimates:
        return None
    used, found = tuple(estimates), tuple(estimates.values())
    shown = used[-1]
    newest, calibration = images[shown].result, images[shown].calibration
    # `usable_estimate` needs all of them
    assert newest.nail is not None
    assert newest.guide is not None
    assert calibration is not None
    camera_from_nail = newest.nail.camera_from_nail
    if len(used) == 1:
        shares = tuple(ImageShare(k == shown, None) for k in range(len(images)))
        return FusedLocalisation(newest, shown, shares, 0.0, 0.0, 0)
    joint, names = fuse(found), tuple(images[k].name for k in used)
    influence = dict(zip(used, np.maximum(leave_one_out(found), 0.0).tolist(), strict=True))
    shares = tuple(ImageShare(k in influence, influence.get(k)) for k in range(len(images)))
    against = disagreement(joint, found, names, parts, camera_from_nail)
    if against is not None:
        result = replace(newest, reasons=(against,))
    else:
        as_found = parts.with_nail_as_found(newest.nail)
        holes = _holes(joint, as_found, camera_from_nail, joint.covariance_with_bend)
        reasons = uncertainty_reasons(holes, departures_of(calibration, newest.guide, newest.nail))
        result = replace(newest, reasons=reasons, guide_from_nail=joint.pose.mean, holes=holes)
    freedom = joint.degrees_of_freedom
    return FusedLocalisation(result, shown, shares, joint.chi_square, chi_square_limit(freedom), freedom)


def usable_estimate(image: ImageResult, parts: Parts) -> PoseEstimate[Guide, Nail] | None:
    """Estimate of `guide_from_nail` from one image; None when it cannot be used."""
    result, calibration = image.result, image.calibration
    if calibration is None or result.guide is None or result.nail is None:
        return None
    if any(reason.code not in _USABLE_THOUGH for reason in result.reasons):
        return None
    return guide_from_nail_of(calibration, parts.guide, parts.nail, result.guide, result.nail)


def _holes(
    joint: JointEstimate[Guide, Nail],
    parts: Parts,
    camera_from_nail: Transform[Camera, Nail],
    covariance: NDArray[np.float64] | None,
) -> tuple[HoleEstimate, ...]:
    """Holes of the joint estimate, with its covariance or without any."""
    nail = parts.nail.bent(joint.curvature_per_m)
    return holes_at(nail, parts.drill_diameter_mm, joint.pose.mean, covariance, camera_from_nail)


@dataclass(frozen=True, slots=True)
class _Grouping:
    """One way to explain a disagreement: images in two groups, by their indices."""

    first: tuple[int, ...]
    second: tuple[int, ...]
    joints: tuple[JointEstimate[Guide, Nail], JointEstimate[Guide, Nail]]  # of each group

    @staticmethod
    def of(estimates: Estimates, first: tuple[int, ...], second: tuple[int, ...]) -> "_Grouping":
        """Fuse each group in itself."""
        one, other = (fuse(tuple(estimates[k] for k in group)) for group in (first, second))
        return _Grouping(first, second, (one, other))

    @property
    def chi_square(self) -> float:
        """Sum of both groups' own."""
        return sum(joint.chi_square for joint in self.joints)

    @property
    def larger(self) -> tuple[int, ...]:
        """The group of most images."""
        return max(self.first, self.second, key=len)

    @property
    def smaller(self) -> tuple[int, ...]:
        """The other group."""
        return self.second if self.larger is self.first else self.first


def disagreement(
    joint: JointEstimate[Guide, Nail],
    estimates: Estimates,
    names: tuple[str, ...],
    parts: Parts,
    camera_from_nail: Transform[Camera, Nail],
) -> Reason | None:
    """Why the images contradict one another, in the order in which they were taken; None when they agree.

    The sentence calls the images by their names; the joint estimate is that of all, `camera_from_nail` that of any.
    """
    if _agree(joint):
        return None
    quoted = IMAGES_CHI_SQUARE.quoted(joint.chi_square, chi_square_limit(joint.degrees_of_freedom))
    grouping = min(_groupings(estimates), key=lambda g: g.chi_square, default=None)
    parted = grouping or _Grouping.of(estimates, (0,), tuple(range(1, len(estimates))))
    measured = (
        f"{_difference(estimates, parted, parts, camera_from_nail)} (chi-square of "
        f"{joint.degrees_of_freedom} degrees of freedom: {quoted})"
    )
    scale = _scale_that_agrees(estimates, camera_from_nail)
    return Reason(IMAGES_CHI_SQUARE.code, _explained(grouping, names, measured, scale))


def _explained(grouping: _Grouping | None, names: tuple[str, ...], measured: str, scale: float | None) -> str:
    size = "" if scale is None else f"the guide is {100.0 * scale:.1f} % as large as its file states"
    if len(names) == 2:
        return (
            f"images {names[0]} and {names[1]} see the nail in different places from the guide: {measured}; the guide "
            f"moved on the bone between them, {size + ', ' if size else ''}or one of the two is wrong, and two images "
            f"cannot tell which: check that mount and guide are tight{', measure the guide' if size else ''} and take "
            "one more image"
        )
    if size:
        return (
            f"images {', '.join(names)} see the nail in different places from the guide: {measured}, and agree if "
            f"{size}: measure one of its lengths and correct the file"
        )
    if grouping is None:
        return (
            f"no images of the {len(names)} agree so well that the others stand out: {measured}; the guide is not held "
            "firmly: tighten mount and guide and take all images again"
        )
    others = ", ".join(names[k] for k in grouping.larger)
    if len(grouping.smaller) > 1:
        between = names[grouping.first[-1]], names[grouping.second[0]]
        return (
            f"the guide moved on the bone between images {between[0]} and {between[1]}: {measured}, while the images "
            "before agree and those after too; check that mount and guide are tight, and use only the images after it"
        )
    odd = grouping.smaller[0]
    if 0 < odd < len(names) - 1:
        return (
            f"image {names[odd]} is the odd one: {measured} from images {others}, which agree before and after it; "
            "leave it out"
        )
    when = "before all others" if odd == 0 else "after all others"
    neighbour = names[1] if odd == 0 else names[odd - 1]
    return (
        f"image {names[odd]}, taken {when}, is the odd one: {measured} from images {others}, which agree; either it is "
        f"wrong or the guide moved on the bone between it and image {neighbour}: check that mount and guide are tight "
        "and take one more image"
    )


def _groupings(estimates: Estimates) -> Iterator[_Grouping]:
    """Ways to part the images in time or to leave one out, after which each part agrees in itself."""
    count = len(estimates)
    if count < 3:
        return
    parts = [(tuple(range(k)), tuple(range(k, count))) for k in range(1, count)]
    parts += [((k,), (*range(k), *range(k + 1, count))) for k in range(1, count - 1)]
    for first, second in parts:
        grouping = _Grouping.of(estimates, first, second)
        if all(_agree(joint) for joint in grouping.joints):
            yield grouping


def _agree(joint: JointEstimate[Guide, Nail]) -> bool:
    return len(joint.weights) < 2 or joint.chi_square <= chi_square_limit(joint.degrees_of_freedom)


def _difference(
    estimates: Estimates, grouping: _Grouping, parts: Parts, camera_from_nail: Transform[Camera, Nail]
) -> str:
    """How far the axes of both groups lie apart, at the hole where it is most, and how much their nails differ."""
    first, second = (_holes(joint, parts, camera_from_nail, None) for joint in grouping.joints)
    offsets_mm = (
        axis_offset_mm(a.axis_guide, b.axis_guide, a.entry_guide_mm, a.exit_guide_mm)
        for a, b in zip(first, second, strict=True)
    )
    entries_mm = [float(np.linalg.norm(offset_mm[:2])) for offset_mm in offsets_mm]
    entry_mm, a, b = max(zip(entries_mm, first, second, strict=True), key=lambda one: one[0])
    depth_mm = abs(float((b.entry_guide_mm - a.entry_guide_mm) @ a.axis_guide.direction))
    between_deg = angle_deg(a.axis_guide, b.axis_guide)
    return (
        f"the axis of hole '{a.id}' differs by {entry_mm:.2f} mm at its entry and {between_deg:.2f}°, "
        f"its depth by {depth_mm:.2f} mm{_other_radii(estimates, grouping)}"
    )


def _other_radii(estimates: Estimates, grouping: _Grouping) -> str:
    first, second = (
        np.mean([estimates[k].errors.shape_deviations for k in group], axis=0)
        for group in (grouping.first, grouping.second)
    )
    apart_mm = {
        name: priors()[parameter][1] * abs(float(a - b))
        for parameter, a, b in zip(SHAPE_PARAMETERS, first, second, strict=False)
        if (name := _RADII.get(parameter)) is not None
    }
    return "".join(f", {name} by {mm:.2f} mm" for name, mm in apart_mm.items() if mm >= NAIL_PRIORS.radius_sd_mm)


def _scale_that_agrees(estimates: Estimates, camera_from_nail: Transform[Camera, Nail]) -> float | None:
    """Size of the guide over that of its file with which images that contradict one another agree; None for none.

    A guide that is larger and farther away by the same share looks the same. The nail's depth follows from the nail's
    own file, so that its distance from the guide is wrong along the ray: by as much in every image, but along another
    ray. `camera_from_nail`, in any of the images, gives the distance of guide and nail.
    """
    less, none, more = (fuse(_nearer(estimates, step_mm)) for step_mm in (-_STEP_MM, 0.0, _STEP_MM))
    curvature = less.chi_square - 2.0 * none.chi_square + more.chi_square
    if curvature <= 0.0:
        return None
    nearer_mm = 0.5 * _STEP_MM * (less.chi_square - more.chi_square) / curvature
    if fuse(_nearer(estimates, nearer_mm)).chi_square > chi_square_limit(none.degrees_of_freedom - 1):
        return None
    guide_mm = float(np.linalg.norm((camera_from_nail @ none.pose.mean.inverse()).translation_mm))
    excess = nearer_mm / guide_mm
    return 1.0 + excess if abs(excess) < _LARGEST_EXCESS else None


def _nearer(estimates: Estimates, shift_mm: float) -> Estimates:
    """The same with the nail nearer to the focal spot by so much, along the ray of each image."""
    return tuple(replace(one, mean=one.mean.moved(_along_ray(one, -shift_mm))) for one in estimates)


def _along_ray(estimate: PoseEstimate[Guide, Nail], shift_mm: float) -> NDArray[np.float64]:
    ray = np.zeros(3) if estimate.errors.ray is None else estimate.errors.ray
    return np.concatenate([np.zeros(3), shift_mm * ray])

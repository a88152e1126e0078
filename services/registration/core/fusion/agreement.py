"""Do the images of one set-up agree within their covariance? If not: which image is it, or what moved, and when?"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.images import IMAGES_CHI_SQUARE, chi_square_limit
from services.registration.core.drill_clearance import angle_deg, axis_offset_mm
from services.registration.core.fusion.fuse import fuse
from services.registration.core.hole_axes import HoleEstimate, holes_at
from services.registration.core.localise import Parts
from services.registration.core.nail.parameters import PRIOR, SHAPE_PARAMETERS, Parameter
from services.registration.core.pose_evidence import PoseEvidence
from shared.errors import Reason
from shared.geometry.frames import Camera, Nail
from shared.geometry.transform import Transform

# Radii that tell one nail from another, by the names that people give them.
_RADII = {
    Parameter.HOLE_RADIUS_EXCESS_MM: "the holes' radius",
    Parameter.NAIL_RADIUS_EXCESS_MM: "the nail's radius",
}
_WORTH_TELLING_MM = 0.03


@dataclass(frozen=True, slots=True)
class Grouping:
    """One way to explain a disagreement: images in two groups, by their indices; each group agrees in itself.

    Attributes
    ----------
    chi_square
        Sum of both groups' own.
    """

    first: tuple[int, ...]
    second: tuple[int, ...]
    chi_square: float

    @property
    def larger(self) -> tuple[int, ...]:
        """The group of most images."""
        return max(self.first, self.second, key=len)

    @property
    def smaller(self) -> tuple[int, ...]:
        """The other group."""
        return self.second if self.larger is self.first else self.first


def leave_one_out(evidence: tuple[PoseEvidence, ...]) -> NDArray[np.float64]:
    """By how much chi-square falls when one image is left out, for each image, shape (K,): 9 on average."""
    whole = fuse(evidence).chi_square
    return np.array([whole - _chi_square(evidence, _without(len(evidence), k)) for k in range(len(evidence))])


def disagreement(
    evidence: tuple[PoseEvidence, ...],
    names: tuple[str, ...],
    parts: Parts,
    camera_from_nail: Transform[Camera, Nail],
) -> Reason | None:
    """Why the images contradict one another, in the order in which they were taken; None when they agree.

    Parameters
    ----------
    names
        What the images are called in the sentence.
    camera_from_nail
        Of any of the images.
    """
    if len(evidence) < 2 or _agree(evidence, tuple(range(len(evidence)))):
        return None
    found = fuse(evidence)
    quoted = IMAGES_CHI_SQUARE.quoted(found.chi_square, chi_square_limit(found.degrees_of_freedom))
    grouping = min(_groupings(evidence), key=lambda g: g.chi_square, default=None)
    parted = grouping or Grouping((0,), tuple(range(1, len(evidence))), np.inf)
    measured = (
        f"{_difference(evidence, parted, parts, camera_from_nail)} (chi-square of "
        f"{found.degrees_of_freedom} degrees of freedom: {quoted})"
    )
    return Reason(IMAGES_CHI_SQUARE.code, _explained(grouping, names, measured))


def _explained(grouping: Grouping | None, names: tuple[str, ...], measured: str) -> str:
    if len(names) == 2:
        return (
            f"images {names[0]} and {names[1]} see the nail in different places from the guide: {measured}; the guide "
            "moved on the bone between them or one of the two is wrong, and two images cannot tell which: check that "
            "mount and guide are tight and take one more image"
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


def _groupings(evidence: tuple[PoseEvidence, ...]) -> Iterator[Grouping]:
    """Ways to part the images in time or to leave one out, after which each part agrees in itself."""
    count = len(evidence)
    if count < 3:
        return
    parts = [(tuple(range(k)), tuple(range(k, count))) for k in range(1, count)]
    parts += [((k,), _without(count, k)) for k in range(1, count - 1)]
    for first, second in parts:
        if _agree(evidence, first) and _agree(evidence, second):
            yield Grouping(first, second, _chi_square(evidence, first) + _chi_square(evidence, second))


def _agree(evidence: tuple[PoseEvidence, ...], chosen: tuple[int, ...]) -> bool:
    found = fuse(tuple(evidence[k] for k in chosen))
    return len(chosen) < 2 or found.chi_square <= chi_square_limit(found.degrees_of_freedom)


def _chi_square(evidence: tuple[PoseEvidence, ...], chosen: tuple[int, ...]) -> float:
    return fuse(tuple(evidence[k] for k in chosen)).chi_square


def _without(count: int, left_out: int) -> tuple[int, ...]:
    return tuple(k for k in range(count) if k != left_out)


def _difference(
    evidence: tuple[PoseEvidence, ...], grouping: Grouping, parts: Parts, camera_from_nail: Transform[Camera, Nail]
) -> str:
    """How far the axes of both groups lie apart, at the hole where it is most, and how much their nails differ."""
    first, second = (
        holes_at(
            parts.nail,
            parts.drill_diameter_mm,
            fuse(tuple(evidence[k] for k in group)).guide_from_nail,
            None,
            camera_from_nail,
        )
        for group in (grouping.first, grouping.second)
    )
    apart = [(_entry_apart_mm(a, b), a, b) for a, b in zip(first, second, strict=True)]
    entry_mm, a, b = max(apart, key=lambda one: one[0])
    depth_mm = abs(float((b.entry_guide_mm - a.entry_guide_mm) @ a.axis_guide.direction))
    between_deg = angle_deg(a.axis_guide, b.axis_guide)
    return (
        f"the axis of hole '{a.id}' differs by {entry_mm:.2f} mm at its entry and {between_deg:.2f}°, "
        f"its depth by {depth_mm:.2f} mm{_other_radii(evidence, grouping)}"
    )


def _other_radii(evidence: tuple[PoseEvidence, ...], grouping: Grouping) -> str:
    first, second = (
        np.mean([evidence[k].errors.shape_deviations for k in group], axis=0)
        for group in (grouping.first, grouping.second)
    )
    apart_mm = {
        name: PRIOR[unknown][1] * abs(float(a - b))
        for unknown, a, b in zip(SHAPE_PARAMETERS, first, second, strict=False)
        if (name := _RADII.get(unknown)) is not None
    }
    return "".join(f", {name} by {mm:.2f} mm" for name, mm in apart_mm.items() if mm >= _WORTH_TELLING_MM)


def _entry_apart_mm(a: HoleEstimate, b: HoleEstimate) -> float:
    offset = axis_offset_mm(a.axis_guide, b.axis_guide, a.entry_guide_mm, a.exit_guide_mm)
    return float(np.linalg.norm(offset[:2]))

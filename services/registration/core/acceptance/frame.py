"""Acceptance of one frame of running fluoroscopy: every limit, and the rules that combine them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from services.registration.core.acceptance.image import (
    BEST_OPENING,
    CONTRAST_TO_NOISE,
    MIRROR_MARGIN,
    OTHER_OPENING,
    HoleView,
    Openings,
    opening_reasons,
)
from services.registration.core.acceptance.search import GUIDE_BALLS
from shared.acceptance import Criterion, Finding, at_least, at_most
from shared.errors import Reason, ReasonCode

_RECORD: Final = "docs/decisions/0012-guidance.md"
_FILMS: Final = f"fitted by inspection on films of `benchmarks.scenes.fluoroscopy_films` ({_RECORD})"
_REQUIREMENT: Final = "required: errors beyond it count as wrong in `distalock bench accuracy`"
_PREDICTED_DEVIATIONS: Final = 4.0

FRAME_GUIDE_BALLS: Final = Criterion(
    code=ReasonCode.GUIDE_NOT_FOUND,
    measured="balls of the guide found near where the last frame showed them",
    limit=at_least(GUIDE_BALLS.limit.value, "", decimals=0),
    depends=GUIDE_BALLS.depends,
    remedy="hold the C-arm still and keep the guide in the image",
    origin="derived: as many as in a single image",
)
FRAME_GUIDE_RMS: Final = Criterion(
    code=ReasonCode.MOTION_BLUR,
    measured="rms distance of the guide's balls from where the guide as a whole puts them",
    limit=at_most(0.8, "px", decimals=2),
    remedy="hold still for a moment",
    origin=_FILMS,
)
FRAME_CONTRAST_TO_NOISE: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="brightness of a hole's opening over the metal around it, in standard deviations of a pixel's noise",
    limit=at_least(CONTRAST_TO_NOISE.limit.value, "", decimals=1),
    remedy="take away what covers it, or raise the dose",
    origin="derived: as in a single image",
)
FRAME_BEST_OPENING: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="visible share of the disc of the hole that shows most",
    limit=at_least(BEST_OPENING.limit.value, "%", decimals=0),
    remedy="move what covers it, or keep the hole inside the image",
    origin="derived: as in a single image",
)
FRAME_OTHER_OPENING: Final = Criterion(
    code=ReasonCode.HOLE_NOT_VISIBLE,
    measured="visible share of the disc of every other hole",
    limit=at_least(OTHER_OPENING.limit.value, "%", decimals=0),
    remedy=FRAME_BEST_OPENING.remedy,
    origin="derived: as in a single image",
)
FRAME_STRUCTURE: Final = Criterion(
    code=ReasonCode.NAIL_MODEL_MISMATCH,
    measured="rms of the smoothed residual at the edges of nail and holes, over that elsewhere, on coarser pixels",
    limit=at_most(2.5, "times", decimals=1),
    remedy="take away what lies over the nail",
    origin=_FILMS,
)
FRAME_UNEXPLAINED: Final = Criterion(
    code=ReasonCode.NAIL_MODEL_MISMATCH,
    measured="pixels around the holes whose residual is beyond four standard deviations of the noise",
    limit=at_most(0.02, "%", decimals=1),
    remedy=FRAME_STRUCTURE.remedy,
    origin=_FILMS,
)
FRAME_TURN: Final = Criterion(
    code=ReasonCode.NAIL_MODEL_MISMATCH,
    measured="rotation of the nail about its x or y axis from where guide and key image predict it",
    limit=at_most(0.5, "°", decimals=1),
    depends="or four predicted standard deviations of the difference if that is more",
    remedy="if the guide was moved, hold the C-arm still until the nail is found anew",
    origin=f"derived: exceeded by one frame in 16,000 if the predicted deviations hold ({_RECORD})",
)
FRAME_SHIFT: Final = Criterion(
    code=ReasonCode.NAIL_MODEL_MISMATCH,
    measured="distance of the nail across its holes from where guide and key image predict it",
    limit=at_most(1.0, "mm", decimals=1),
    remedy=FRAME_TURN.remedy,
    origin=f"{_REQUIREMENT} ({_RECORD})",
)
FRAME_BLUR: Final = Criterion(
    code=ReasonCode.MOTION_BLUR,
    measured="blur of the nail's edges, as a standard deviation, beyond that of the key image",
    limit=at_most(0.8, "px", decimals=1),
    depends="quoted with the key image's blur added to both",
    remedy="hold C-arm and leg still for a moment",
    origin=_FILMS,
)
FRAME_TILT_DEVIATION: Final = Criterion(
    code=ReasonCode.UNCERTAINTY_TOO_LARGE,
    measured="standard deviation of the nail's tilt by this frame's pixels alone",
    limit=at_most(1.5, "°", decimals=1),
    remedy="raise the dose, or bring the holes to the middle of the image",
    origin=f"{_REQUIREMENT} ({_RECORD})",
)
FRAME_MIRROR_MARGIN: Final = Criterion(
    code=ReasonCode.MIRROR_AMBIGUOUS,
    measured="logarithm of the likelihood ratio between the pose and its reflected tilt, every eighth frame",
    limit=at_least(MIRROR_MARGIN.limit.value, "", decimals=1),
    remedy="hold the C-arm still until the nail is found anew",
    origin="derived: as in a single image",
)
NO_KEY_IMAGE: Final = Finding(
    code=ReasonCode.NAIL_NOT_FOUND,
    observed="the nail is still being searched for in an earlier frame",
    remedy="hold the C-arm still for a moment",
)


_OPENINGS: Final = Openings(FRAME_BEST_OPENING, FRAME_OTHER_OPENING)


@dataclass(frozen=True, slots=True)
class FrameEvidence:
    """What the acceptance of a frame depends on in which guide and nail were found.

    Attributes
    ----------
    structure
        As `ResidualStatistics.structure`.
    unexplained
        Share of the pixels around the holes whose residual is beyond four standard deviations of the noise.
    turned_deg, turn_sd_deg
        Rotation of the observed nail from the predicted one about the nail's x and y axes, and its predicted standard
        deviation.
    across_mm
        Distance of the observed nail from the predicted one across the holes.
    blur_px, key_blur_px
        Standard deviation of the blur in this frame and in the key image.
    tilt_sd_deg
        Standard deviation of the nail's tilt by this frame's pixels alone.
    """

    holes: tuple[HoleView, ...]
    structure: float
    unexplained: float
    turned_deg: tuple[float, ...]
    turn_sd_deg: tuple[float, ...]
    across_mm: float
    blur_px: float
    key_blur_px: float
    tilt_sd_deg: float


def frame_reasons(evidence: FrameEvidence) -> tuple[Reason, ...]:
    """Reasons against the advice of a frame; none when it is accepted."""
    return (
        *opening_reasons(evidence.holes, _OPENINGS, FRAME_CONTRAST_TO_NOISE),
        *_unexplained(evidence),
        *_displaced(evidence),
        *_blurred(evidence),
        *_uncertain(evidence),
    )


def margin_reasons(log_likelihood_ratio: float | None) -> tuple[Reason, ...]:
    """Refuse a tilt whose reflection explains the frame nearly as well; `None` means that there is no other optimum."""
    if log_likelihood_ratio is None or FRAME_MIRROR_MARGIN.is_met(log_likelihood_ratio):
        return ()
    quoted = FRAME_MIRROR_MARGIN.quoted(log_likelihood_ratio)
    observation = f"the reflected tilt explains this frame nearly as well: logarithm of the likelihood ratio {quoted}"
    return (FRAME_MIRROR_MARGIN.reason(observation),)


def _unexplained(evidence: FrameEvidence) -> Iterator[Reason]:
    if FRAME_STRUCTURE.is_met(evidence.structure) and FRAME_UNEXPLAINED.is_met(evidence.unexplained):
        return
    yield FRAME_STRUCTURE.reason(
        f"the residual at the edges of nail and holes is {FRAME_STRUCTURE.quoted(evidence.structure)} that elsewhere, "
        f"and {FRAME_UNEXPLAINED.quoted(evidence.unexplained)} of the pixels around the holes are not explained"
    )


def _displaced(evidence: FrameEvidence) -> Iterator[Reason]:
    least_deg = FRAME_TURN.limit.value
    turns = [
        (abs(turn_deg), max(least_deg, _PREDICTED_DEVIATIONS * sd_deg))
        for turn_deg, sd_deg in zip(evidence.turned_deg, evidence.turn_sd_deg, strict=True)
    ]
    if all(FRAME_TURN.is_met(*turn) for turn in turns) and FRAME_SHIFT.is_met(evidence.across_mm):
        return
    turned = " and ".join(FRAME_TURN.quoted(*turn) for turn in turns)
    yield FRAME_TURN.reason(
        f"the nail is turned by {turned} about its axes and lies {FRAME_SHIFT.quoted(evidence.across_mm)} from where "
        "the guide predicts it"
    )


def _blurred(evidence: FrameEvidence) -> Iterator[Reason]:
    most_px = evidence.key_blur_px + FRAME_BLUR.limit.value
    if not FRAME_BLUR.is_met(evidence.blur_px, most_px):
        yield FRAME_BLUR.reason(
            f"the nail's edges are blurred by {FRAME_BLUR.quoted(evidence.blur_px, most_px)} in this frame, by "
            f"{evidence.key_blur_px:.1f} px in the key image"
        )


def _uncertain(evidence: FrameEvidence) -> Iterator[Reason]:
    if not FRAME_TILT_DEVIATION.is_met(evidence.tilt_sd_deg):
        quoted = FRAME_TILT_DEVIATION.quoted(evidence.tilt_sd_deg)
        yield FRAME_TILT_DEVIATION.reason(f"this frame determines the tilt with a standard deviation of {quoted}")

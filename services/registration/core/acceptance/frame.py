"""Acceptance of one frame of running fluoroscopy: the rules; the limits stand in `criteria`."""

from collections.abc import Iterator
from dataclasses import dataclass

from services.registration.core.acceptance.criteria import (
    FRAME_BLUR,
    FRAME_CONTRAST_TO_NOISE,
    FRAME_MIRROR_MARGIN,
    FRAME_OPENINGS,
    FRAME_SHIFT,
    FRAME_STRUCTURE,
    FRAME_TILT_DEVIATION,
    FRAME_TURN,
    FRAME_UNEXPLAINED,
)
from services.registration.core.acceptance.image import HoleView, opening_reasons
from services.registration.core.tuning import FRAME_TRACKING
from shared.errors import Reason


@dataclass(frozen=True, slots=True)
class FrameEvidence:
    """What the acceptance of a frame depends on in which guide and nail were found."""

    holes: tuple[HoleView, ...]
    structure: float  # as `ResidualStatistics.structure`
    unexplained: float  # share of the pixels around the holes whose residual is beyond four deviations of the noise
    # Rotation of the observed nail from the predicted one about both directions across the holes, and its predicted
    # deviation
    turned_deg: tuple[float, ...]
    turn_sd_deg: tuple[float, ...]
    across_mm: float  # distance of the observed nail from the predicted one across the holes
    # Standard deviation of the blur in this frame and in the reference image
    blur_px: float
    reference_blur_px: float
    tilt_sd_deg: float  # standard deviation of the nail's tilt by this frame's pixels alone


def frame_reasons(evidence: FrameEvidence) -> tuple[Reason, ...]:
    """Reasons against the advice of a frame; none when it is accepted."""
    return (
        *opening_reasons(evidence.holes, FRAME_OPENINGS, FRAME_CONTRAST_TO_NOISE),
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
        (abs(turn_deg), max(least_deg, FRAME_TRACKING.predicted_sigmas * sd_deg))
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
    most_px = evidence.reference_blur_px + FRAME_BLUR.limit.value
    if not FRAME_BLUR.is_met(evidence.blur_px, most_px):
        yield FRAME_BLUR.reason(
            f"the nail's edges are blurred by {FRAME_BLUR.quoted(evidence.blur_px, most_px)} in this frame, by "
            f"{evidence.reference_blur_px:.1f} px in the reference image"
        )


def _uncertain(evidence: FrameEvidence) -> Iterator[Reason]:
    if not FRAME_TILT_DEVIATION.is_met(evidence.tilt_sd_deg):
        quoted = FRAME_TILT_DEVIATION.quoted(evidence.tilt_sd_deg)
        yield FRAME_TILT_DEVIATION.reason(f"this frame determines the tilt with a standard deviation of {quoted}")

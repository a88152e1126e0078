"""Whether one frame of running fluoroscopy may be believed, and if not, why and what to do."""

from dataclasses import dataclass

from services.registration.core.guidance.nail_tracking import FollowedNail, Look
from services.registration.core.nail.judgement import CLEAR_VIEW
from shared.errors import Reason, ReasonCode
from shared.figures import figure, figures

LEAST_CONTRAST_TO_NOISE = 3.0
LARGEST_STRUCTURE = 2.5
LARGEST_UNEXPLAINED = 0.02
LARGEST_BLUR_EXCESS_PX = 0.8
LEAST_MARGIN = 8.0
LARGEST_SD_DEG = 1.5
_SURPRISED_DEVIATIONS = 4.0
_ALWAYS_ALLOWED_DEG, _ALWAYS_ALLOWED_MM = 0.5, 1.0


@dataclass(frozen=True, slots=True)
class Surprise:
    """Nail as seen against nail as the guide predicts it.

    Attributes
    ----------
    turned_deg, turn_sd_deg
        Rotation between the two about the nail's x and y axes, and its predicted standard deviation.
    across_mm
        Distance between them across the holes.
    """

    turned_deg: tuple[float, ...]
    turn_sd_deg: tuple[float, ...]
    across_mm: float


def reasons_against_frame(nail: FollowedNail, look: Look, surprise: Surprise) -> tuple[Reason, ...]:
    """Reasons against an answer from this frame; none means that it may be told."""
    return (*_covered(nail), *_unexplained(nail), *_surprised(surprise), *_blurred(nail, look), *_unsure(nail))


def reasons_against_margin(log_likelihood_ratio: float | None) -> tuple[Reason, ...]:
    """Refuse a tilt whose reflection explains the frame nearly as well; `None` means that there is no other optimum."""
    if log_likelihood_ratio is None or log_likelihood_ratio >= LEAST_MARGIN:
        return ()
    message = (
        "the reflected tilt explains this frame nearly as well: logarithm of the likelihood ratio "
        f"{figure(log_likelihood_ratio, LEAST_MARGIN, 1)} (limit {LEAST_MARGIN:.0f}); hold the C-arm still until the "
        "nail is found anew"
    )
    return (Reason(ReasonCode.MIRROR_AMBIGUOUS, message),)


def _blurred(nail: FollowedNail, look: Look) -> tuple[Reason, ...]:
    limit_px = look.blur_px + LARGEST_BLUR_EXCESS_PX
    if nail.blur_px <= limit_px:
        return ()
    measured, limit = figures(nail.blur_px, limit_px, 1)
    message = (
        f"the nail's edges are blurred by {measured} px in this frame (limit {limit} px, "
        f"{look.blur_px:.1f} px when it stood still); hold C-arm and leg still for a moment"
    )
    return (Reason(ReasonCode.MOTION_BLUR, message),)


def _covered(nail: FollowedNail) -> tuple[Reason, ...]:
    reasons = []
    clearest = max(nail.holes, key=lambda hole: hole.opening)
    for hole in nail.holes:
        least = CLEAR_VIEW.of_best if hole is clearest else CLEAR_VIEW.of_others
        if not hole.opening >= least:
            message = (
                f"hole '{hole.id}' shows {figure(100.0 * hole.opening, 100.0 * least, 0)} % of its disc in this frame "
                f"(limit {100.0 * least:.0f} %); move what covers it, or keep the hole inside the image"
            )
            reasons.append(Reason(ReasonCode.HOLE_NOT_VISIBLE, message))
        elif hole.contrast_to_noise < LEAST_CONTRAST_TO_NOISE:
            message = (
                f"hole '{hole.id}' is {figure(hole.contrast_to_noise, LEAST_CONTRAST_TO_NOISE, 1)} standard deviations "
                f"of the noise brighter than the metal around it in this frame (limit {LEAST_CONTRAST_TO_NOISE:.1f}); "
                "take away what covers it, or raise the dose"
            )
            reasons.append(Reason(ReasonCode.HOLE_NOT_VISIBLE, message))
    return tuple(reasons)


def _unexplained(nail: FollowedNail) -> tuple[Reason, ...]:
    if nail.structure <= LARGEST_STRUCTURE and nail.unexplained <= LARGEST_UNEXPLAINED:
        return ()
    message = (
        f"the residual along the nail's edges is {figure(nail.structure, LARGEST_STRUCTURE, 1)} times that elsewhere "
        f"(limit {LARGEST_STRUCTURE:.1f}), and {figure(100.0 * nail.unexplained, 100.0 * LARGEST_UNEXPLAINED, 1)} % of "
        f"the pixels around the holes are not explained (limit {100.0 * LARGEST_UNEXPLAINED:.0f} %); take away what "
        "lies over the nail"
    )
    return (Reason(ReasonCode.NAIL_MODEL_MISMATCH, message),)


def _surprised(surprise: Surprise) -> tuple[Reason, ...]:
    limits = [max(_ALWAYS_ALLOWED_DEG, _SURPRISED_DEVIATIONS * sd) for sd in surprise.turn_sd_deg]
    within = all(abs(turn) <= limit for turn, limit in zip(surprise.turned_deg, limits, strict=True))
    if within and surprise.across_mm <= _ALWAYS_ALLOWED_MM:
        return ()
    compared = [figures(abs(turn), limit, 1) for turn, limit in zip(surprise.turned_deg, limits, strict=True)]
    turned = " and ".join(f"{turn}° (limit {limit}°)" for turn, limit in compared)
    message = (
        f"the nail is turned by {turned} about its axes and lies {figure(surprise.across_mm, _ALWAYS_ALLOWED_MM, 1)} "
        f"mm (limit {_ALWAYS_ALLOWED_MM:g} mm) from where the guide puts it; if the guide was moved, hold the C-arm "
        "still until the nail is found anew"
    )
    return (Reason(ReasonCode.NAIL_MODEL_MISMATCH, message),)


def _unsure(nail: FollowedNail) -> tuple[Reason, ...]:
    sd_deg = 180.0 / 3.141592653589793 * max(float(nail.covariance[k, k]) ** 0.5 for k in (0, 1))
    if sd_deg <= LARGEST_SD_DEG:
        return ()
    message = (
        f"this frame tells the tilt with a standard deviation of {figure(sd_deg, LARGEST_SD_DEG, 1)}° (limit "
        f"{LARGEST_SD_DEG:g}°); raise the dose, or bring the holes to the middle of the image"
    )
    return (Reason(ReasonCode.UNCERTAINTY_TOO_LARGE, message),)

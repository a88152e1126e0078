"""Acceptance of one image: the rules that combine the limits of `criteria`.

An image is refused at three places, each with all reasons that apply there: where guide or nail is not found, after the
fit of the nail (`fit_reasons`), and when guide and nail are put together (`localisation_reasons`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from services.registration.core.acceptance.criteria import (
    AGREEMENT_BESIDE_OBJECTS,
    AGREEMENT_OF_FILTERED,
    ATTENUATION,
    AXIS_BOUND,
    BENT_MARGIN,
    BEST_RIM,
    BORED_TWICE_REMEDY,
    BY_DISPLACED_HOLES,
    CHANCE_TO_PASS,
    CLEAR_VIEW,
    CONTRAST_TO_NOISE,
    DIAMETER_EXCESS,
    DISTORTION_DEVIATION,
    ENTRY_BOUND,
    FILTERED,
    HOLE_CHANNEL_REMEDY,
    HOLE_ORDER,
    LAG_REMEDY,
    MIRROR_MARGIN,
    MIRROR_MARGIN_OF_ONE_HOLE,
    MUCH_PROCESSED,
    NO_UNCERTAINTY,
    NOISE_INFLATION,
    OTHER_RIM,
    PROCESSING,
    SPOT,
    STRAIGHT_MARGIN,
    STRUCTURE,
    TAILED_NOISE_INFLATION,
    TILT,
    Openings,
)
from services.registration.core.c_arm_advice import CArmTurn
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.tuning import AGREEMENT_OF_PARTS, HOLE_CHANNELS, NAIL_AS_BUILT
from shared.acceptance import Criterion
from shared.errors import Reason, ReasonCode
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform
from shared.parts.as_built import MEASURE_THE_GUIDE, MEASURE_THE_RING, because_of_the_guide, because_of_the_ring


@dataclass(frozen=True, slots=True)
class HoleView:
    """How a hole was seen."""

    id: str
    opening: float  # area through which background is seen, clear of balls and in the image, over the bore's disc
    contrast_to_noise: float  # brightness of the opening over the metal around it, in standard deviations of a pixel


@dataclass(frozen=True, slots=True)
class ResidualStatistics:
    """What the model does not explain."""

    structure: float  # rms of the smoothed residual around rims and edges, over that elsewhere: one where all is noise
    noise_inflation: float  # variance of a mean over many pixels, over that of independent pixels
    # Largest smoothed residual in and about a hole, as a share of the step from metal to background, if it is far
    # beyond noise: a wrong pose may explain all but a small piece of a hole that shows between two balls
    spot: float
    darkness: float  # largest smoothed residual on the dark side, anywhere, as a share of that step


@dataclass(frozen=True, slots=True)
class FitEvidence:
    """What the acceptance of a fitted nail depends on."""

    holes: tuple[HoleView, ...]
    residual: ResidualStatistics
    # Fitted radii less those of the part
    hole_radius_excess_mm: float
    nail_radius_excess_mm: float
    # Logarithm of the likelihood ratio between this pose and the other optimum (at least 1.5° away, in practice the
    # reflected tilt), or, when there is no other, the best pose with pitch or roll 3° away. The noise's correlation is
    # divided out, so that the ratio is that of as many independent samples. For a competing pose that was abandoned it
    # is a lower bound.
    mirror_margin: float
    error_ratio: float  # of the nail's rotation, over what the noise explains
    rim_shares: tuple[float, ...]  # of each hole's rim that takes part in the fit, in the order of `holes`
    # Of a straight nail, the same over the pose of a bent one that looks nearly alike, mostly the reflected tilt with a
    # radius of about 400 mm. Infinite where such a pose was far from explaining the image.
    bent_margin: float = math.inf
    # Of a bent nail, the same over the pose of the straight one, where that has another tilt; infinite elsewhere.
    straight_margin: float = math.inf
    openings: Openings = CLEAR_VIEW
    # Logarithm of the metal's attenuation over that of the part's material, nearer to 0 by two standard errors
    log_attenuation: float = 0.0
    objects_left_out: bool = False  # pixels over the nail that are darker than an earlier fit
    # Variance of the residual over the one by its median: a filter against noise leaves a few places as they were
    residual_tails: float = 1.0
    hole_spread_mm: float = 0.0  # standard deviation of the holes' places about their file's, as the image shows it
    second_bore_deg: float = 0.0  # how far the holes as filed may be turned from the fit, where they look bored twice
    channel_deg: float = 0.0  # how far the holes may be turned from the fit by a channel in what fills them

    @property
    def filtered(self) -> bool:
        """Whether the residual is that of a filter against noise; what looks like an object is then its trace."""
        return self.residual_tails > FILTERED

    @property
    def has_tails(self) -> bool:
        """Whether few residuals are far larger than most, as beside objects and behind filters, but not by blur."""
        return not self.residual_tails <= AGREEMENT_OF_PARTS.usual_tails

    @property
    def beside_objects(self) -> bool:
        """Whether objects were left out that are none of a filter's traces."""
        return self.objects_left_out and not self.filtered


@dataclass(frozen=True, slots=True)
class Departures:
    """What an image shows to be otherwise than the model and the part files have it, and makes axes uncertain."""

    error_ratio: float = 1.0  # of the nail's rotation, over what the noise explains
    beside_objects: bool = False  # see `FitEvidence.beside_objects`
    second_bore_deg: float = 0.0  # see `FitEvidence.second_bore_deg`
    channel_deg: float = 0.0  # see `FitEvidence.channel_deg`
    display_turn_deg: float = 0.0  # standard error of its rotation by a display's curve that changes with the place
    other_bend_deg: float = 0.0  # how far the holes' axes are of a nail bent otherwise that explains the image as well
    lag_px: float = 0.0  # how far the guide's balls reach to one side: earlier frames are in the image
    # Of balls and holes about their places in the files, as the image shows it
    guide_spread_mm: float = 0.0
    ring_spread_mm: float = 0.0
    hole_spread_mm: float = 0.0

    def cause_of_uncertainty(self) -> tuple[str, str]:
        """Clause that names the cause other than noise, and what to do about it; empty where noise is the cause."""
        causes = (
            (_because_of_second_bores(self.second_bore_deg), BORED_TWICE_REMEDY),
            (_because_of_channels(self.channel_deg), HOLE_CHANNEL_REMEDY),
            _disagreement(self),
            (_because_of_the_display(self.display_turn_deg), PROCESSING.remedy),
            (_because_of_another_bend(self.other_bend_deg), MIRROR_MARGIN.remedy),
            (_because_of_lag(self.lag_px), LAG_REMEDY),
            (because_of_the_guide(self.guide_spread_mm), MEASURE_THE_GUIDE),
            (because_of_the_ring(self.ring_spread_mm), MEASURE_THE_RING),
            (_because_of_the_nail(self.hole_spread_mm), DIAMETER_EXCESS.remedy),
        )
        return next((cause for cause in causes if cause[0]), ("", ""))


AS_MODELLED: Final = Departures()


@dataclass(frozen=True, slots=True, eq=False)
class LocalisationEvidence:
    """What the acceptance of a localisation depends on in which ring, guide and nail were all found."""

    calibration: CArmCalibration
    guide: GuidePart
    nail: NailPart
    camera_from_nail: Transform[Camera, Nail]
    guide_from_nail: Transform[Guide, Nail]
    holes: tuple[HoleEstimate, ...]
    correction: CArmTurn
    departures: Departures = AS_MODELLED


def fit_reasons(evidence: FitEvidence) -> tuple[Reason, ...]:
    """Reasons against a fitted nail; none when it is accepted."""
    mismatch = tuple(_mismatch(evidence))
    # what the model does not explain counts as noise: then neither dose nor another direction would help
    because, of_disagreement = _disagreement(evidence)
    remedy = STRUCTURE.remedy if mismatch and not evidence.filtered else of_disagreement
    return (
        *opening_reasons(evidence.holes, evidence.openings, remedy=remedy),
        *_covered(evidence),
        *mismatch,
        *_processed(evidence),
        *_ambiguity(evidence, because, remedy if because else ""),
    )


def localisation_reasons(evidence: LocalisationEvidence) -> tuple[Reason, ...]:
    """Reasons against a localisation; none when it is accepted."""
    return (
        *_extrapolated(evidence),
        *_exchanged(evidence),
        *(reason for hole in evidence.holes for reason in _tilted(hole, evidence.correction)),
        *uncertainty_reasons(evidence.holes, evidence.departures),
    )


def uncertainty_reasons(holes: tuple[HoleEstimate, ...], departures: Departures) -> tuple[Reason, ...]:
    """Reasons against holes whose axes are too uncertain, whether from one image or from several."""
    cause = departures.cause_of_uncertainty()
    return tuple(reason for hole in holes for reason in _uncertain(hole, *cause))


def opening_reasons(
    holes: tuple[HoleView, ...],
    openings: Openings,
    contrast: Criterion[ReasonCode] = CONTRAST_TO_NOISE,
    remedy: str = "",
) -> Iterator[Reason]:
    """Reasons against holes that show too little; `remedy` replaces that of too little contrast."""
    best = max(holes, key=lambda view: view.opening)
    for view in holes:
        least = openings.of_best if view is best else openings.of_others
        if not least.is_met(view.opening):
            yield least.reason(f"hole '{view.id}' shows {least.quoted(view.opening)} of its disc")
        elif not contrast.is_met(view.contrast_to_noise):
            yield contrast.reason(
                f"hole '{view.id}' is brighter than the metal around it by {contrast.quoted(view.contrast_to_noise)} "
                "standard deviations of the noise",
                remedy,
            )


def _covered(evidence: FitEvidence) -> Iterator[Reason]:
    best = max(evidence.rim_shares)
    for view, share in zip(evidence.holes, evidence.rim_shares, strict=True):
        least = BEST_RIM if share == best else OTHER_RIM
        if not least.is_met(share):
            sentence = f"the rim of hole '{view.id}' is visible over {least.quoted(share)} of its length"
            yield least.reason(sentence, PROCESSING.remedy if evidence.filtered else "")


def _mismatch(evidence: FitEvidence) -> Iterator[Reason]:
    diameters = (("holes measure", evidence.hole_radius_excess_mm), ("nail measures", evidence.nail_radius_excess_mm))
    for what, excess_mm in diameters:
        if not DIAMETER_EXCESS.is_met(abs(2.0 * excess_mm)):
            quoted = DIAMETER_EXCESS.quoted(2.0 * excess_mm, sign="+")
            yield DIAMETER_EXCESS.reason(f"against the nail file the {what} {quoted} in diameter")
    times = math.exp(abs(evidence.log_attenuation))
    if not ATTENUATION.is_met(times):
        nail, filed = "the nail", "the material in its file"
        more, less = (nail, filed) if evidence.log_attenuation > 0.0 else (filed, nail)
        yield ATTENUATION.reason(f"{more} attenuates at least {ATTENUATION.quoted(times)} as much as {less}")
    residual = evidence.residual
    if not STRUCTURE.is_met(residual.structure):
        yield STRUCTURE.reason(
            f"the residual at the edges of nail and holes is {STRUCTURE.quoted(residual.structure)} that elsewhere"
        )
    if not SPOT.is_met(residual.spot):
        yield SPOT.reason(
            f"a spot at a hole differs from the best fit by {SPOT.quoted(residual.spot)} of the step from metal to "
            "background: something lies over it, or balls hide so much of its rim that the pose is wrong"
        )
    inflation = TAILED_NOISE_INFLATION if evidence.has_tails else NOISE_INFLATION
    if not inflation.is_met(residual.noise_inflation):
        quoted = inflation.quoted(residual.noise_inflation)
        by_object = "something that the nail file does not describe lies there"
        by_object = by_object if evidence.has_tails else f"{by_object}, or the image is blurred"
        yield inflation.reason(
            "after the noise's own correlation is removed, the residual around the nail is still correlated over "
            f"{quoted}: {'a filter does that' if evidence.filtered else by_object}",
            PROCESSING.remedy if evidence.filtered else "",
        )


def _processed(evidence: FitEvidence) -> Iterator[Reason]:
    """What was left out by a wrong fit can make that fit look right: what remains must be plain."""
    beside = AGREEMENT_BESIDE_OBJECTS if evidence.beside_objects else AGREEMENT_OF_FILTERED
    if evidence.objects_left_out and not beside.is_met(evidence.error_ratio):
        by_object = "something dark lies over the nail, and beside it"
        yield beside.reason(
            f"{by_object if evidence.beside_objects else 'a filter against noise was on, and'} parts of the image "
            f"disagree about the nail's rotation by {beside.quoted(evidence.error_ratio)} what the noise explains"
        )
    elif not PROCESSING.is_met(evidence.error_ratio):
        yield PROCESSING.reason(
            f"parts of the image disagree about the nail's rotation by {PROCESSING.quoted(evidence.error_ratio)} what "
            "the noise explains: the display has changed local contrast, or something unknown lies there"
        )


def _ambiguity(evidence: FitEvidence, because: str, remedy: str) -> Iterator[Reason]:
    one_hole = len(evidence.holes) == 1
    least = MIRROR_MARGIN_OF_ONE_HOLE if one_hole else MIRROR_MARGIN
    if not least.is_met(evidence.mirror_margin):
        other = "the nail has one hole, and another tilt" if one_hole else "the reflected tilt"
        yield least.reason(
            f"{other} explains the image nearly as well: logarithm of the likelihood ratio "
            f"{least.quoted(evidence.mirror_margin)}{because}",
            remedy,
        )
    if not BENT_MARGIN.is_met(evidence.bent_margin):
        yield BENT_MARGIN.reason(
            "a nail that is bent, with another tilt, explains the image better than a straight one: logarithm of the "
            f"likelihood ratio {BENT_MARGIN.quoted(evidence.bent_margin)}",
            remedy,
        )
    if not STRAIGHT_MARGIN.is_met(evidence.straight_margin):
        yield STRAIGHT_MARGIN.reason(
            "a straight nail with another tilt explains the image nearly as well as a bent one: logarithm of the "
            f"likelihood ratio {STRAIGHT_MARGIN.quoted(evidence.straight_margin)}",
            remedy,
        )


def _extrapolated(evidence: LocalisationEvidence) -> Iterator[Reason]:
    calibration, displaced = evidence.calibration, because_of_the_ring(evidence.departures.ring_spread_mm)
    for hole in evidence.nail.holes:
        place_px = calibration.image_from_camera(evidence.camera_from_nail @ hole.axis.point_mm)
        deviation_px = float(calibration.distortion.standard_deviation_at(place_px))
        if not DISTORTION_DEVIATION.is_met(deviation_px):
            yield DISTORTION_DEVIATION.reason(
                f"nail hole '{hole.id}' lies at ({place_px[0]:.0f}, {place_px[1]:.0f}) px, where the ring leaves the "
                f"image's distortion uncertain by {DISTORTION_DEVIATION.quoted(deviation_px)}{displaced}",
                MEASURE_THE_RING if displaced else "",
            )


def _exchanged(evidence: LocalisationEvidence) -> Iterator[Reason]:
    """Holes of the same id belong together: those of the nail must follow one another as those of the guide do."""
    in_guide = {hole.id: hole.axis.point_mm for hole in evidence.guide.holes}
    in_nail = {
        hole.id: evidence.guide_from_nail @ hole.axis.point_mm for hole in evidence.nail.holes if hole.id in in_guide
    }
    for first, second in pairwise(in_nail):
        by_guide, by_nail = in_guide[second] - in_guide[first], in_nail[second] - in_nail[first]
        if float(by_guide @ by_nail) < 0.0:
            yield HOLE_ORDER.reason(
                f"from hole '{first}' to hole '{second}' the nail's file goes {by_nail[0]:+.1f} mm along the guide's x "
                f"axis and the guide's file {by_guide[0]:+.1f} mm (limit: the same direction)"
            )


def _tilted(hole: HoleEstimate, correction: CArmTurn) -> Iterator[Reason]:
    if not TILT.is_met(hole.tilt_to_ray_deg):
        yield TILT.reason(
            f"the axis of nail hole '{hole.id}' is tilted by {TILT.quoted(hole.tilt_to_ray_deg)} against the beam",
            f"turn the C-arm by {correction.about_x_deg:+.1f}° about the image's x axis and "
            f"{correction.about_y_deg:+.1f}° about its y axis and take one more image",
        )


def _uncertain(hole: HoleEstimate, because: str, remedy: str) -> Iterator[Reason]:
    if hole.offset is None:
        yield NO_UNCERTAINTY.reason(f"the axis of hole '{hole.id}' has no uncertainty: {NO_UNCERTAINTY.observed}")
        return
    entry_mm, axis_deg = hole.offset.entry_bound_mm, hole.offset.axis_bound_deg
    chance = hole.clearance_probability(hole.offset)
    if ENTRY_BOUND.is_met(entry_mm) and AXIS_BOUND.is_met(axis_deg) and CHANCE_TO_PASS.is_met(chance):
        return
    yield ENTRY_BOUND.reason(
        f"the axis of nail hole '{hole.id}' is known to {ENTRY_BOUND.quoted(entry_mm)} and "
        f"{AXIS_BOUND.quoted(axis_deg)} with 95 % confidence, and a {hole.drill_diameter_mm:g} mm drill would "
        f"pass it with a chance of {CHANCE_TO_PASS.quoted(chance)}{because}",
        remedy if because else ENTRY_BOUND.remedy,
    )


def _disagreement(shown: FitEvidence | Departures) -> tuple[str, str]:
    """Clause that says by how much parts of an image disagree, and what to do about it; empty where they agree."""
    if shown.error_ratio <= MUCH_PROCESSED:
        return "", ""
    because = f"; parts of the image disagree by {shown.error_ratio:.1f} times what the noise explains"
    beside_places = _because_of_the_nail(shown.hole_spread_mm)
    if beside_places and not shown.beside_objects and shown.error_ratio <= BY_DISPLACED_HOLES:
        return because + beside_places, DIAMETER_EXCESS.remedy
    return because, (AGREEMENT_BESIDE_OBJECTS if shown.beside_objects else PROCESSING).remedy


def _because_of_the_display(turn_deg: float) -> str:
    if turn_deg <= 0.0:
        return ""
    return f"; local contrast differs from place to place, which may turn the nail by {turn_deg:.2f}° (rms)"


def _because_of_another_bend(apart_deg: float) -> str:
    if apart_deg <= 0.0:
        return ""
    return f"; a nail that is bent otherwise, its holes by {apart_deg:.2f}°, explains the image nearly as well"


def _because_of_lag(lag_px: float) -> str:
    if lag_px <= 0.0:
        return ""
    return f"; the guide's balls have tails that draw them {lag_px:.2f} px to one side: earlier frames are in the image"


def _because_of_second_bores(turn_deg: float) -> str:
    if turn_deg <= NAIL_AS_BUILT.much_turned_deg:
        return ""
    return f"; the holes look bored twice, askew, so that their axes may lie {turn_deg:.1f}° (rms) from the estimate"


def _because_of_channels(turn_deg: float) -> str:
    if turn_deg <= HOLE_CHANNELS.much_turned_deg:
        return ""
    return (
        "; what is in the holes has an edge of its own inside their rims, as of a drilled channel or a plug, so that "
        f"their axes may lie {turn_deg:.1f}° (rms) from the estimate"
    )


def _because_of_the_nail(hole_spread_mm: float) -> str:
    if hole_spread_mm <= NAIL_AS_BUILT.much_displaced_mm:
        return ""
    return f"; the nail's holes lie {hole_spread_mm:.2f} mm (rms) from where its file has them"

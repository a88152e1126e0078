"""Tuned values of imaging: unit, effect and provenance of each. Those of single balls are in `shared/xray/tuning.py`.

Lengths named `_detector_mm` become pixels of an image by `shared.xray.pixel_scale`.
"""

from dataclasses import dataclass
from typing import Final

from shared.tuning import declared_groups, derived, fitted, physical, standard, tuned

_IDENTIFICATION: Final = fitted("by inspection on the seeded rings of `python -m benchmarks.imaging.identification`")
_CALIBRATION: Final = fitted("by inspection on the seeded images of `python -m benchmarks.imaging.calibration`")
_BALLS: Final = fitted("by inspection on the seeded images of `python -m benchmarks.imaging.ball_detection`")
_RING_BALLS: Final = fitted("rings with displaced balls: `distalock bench built_parts --kind ring_balls --seeds fit`")
_LIVE: Final = fitted("by inspection on the seeded frames of `python -m benchmarks.imaging.live_mode`")
_STILL: Final = fitted("by inspection on the seeded frames of `tests/unit/services/imaging/core/test_still_frames.py`")
_QUALITY: Final = fitted("by inspection on seeded images of damaged rings")
_UNRECORDED: Final = fitted("by inspection; no run that compared alternatives is recorded")
_DRAWN: Final = fitted("by inspection of drawn pages; nothing is measured by it")
_TEN_PER_CENT: Final = derived("nominal C-arm values may be wrong by ten per cent")


@dataclass(frozen=True, slots=True)
class NominalValues:
    """What is assumed of a C-arm beside its nominal values."""

    ring_to_image_plane: float = tuned(
        0.025,
        "1",
        "distance of the ring's plate from the image plane, over that of the focal spot",
        physical("housing and anti-scatter grid lie between them, about 25 mm"),
    )
    source_sd_mm: tuple[float, float, float] = tuned(
        (100.0, 100.0, 150.0), "mm", "standard deviations of the nominal focal spot in the ring's frame", _TEN_PER_CENT
    )


@dataclass(frozen=True, slots=True)
class RingDetection:
    """Dark discs among which the ring is sought."""

    radius_tolerance: float = tuned(0.2, "1", "by which sought radii may differ from the nominal ones", _BALLS)
    most_others: int = tuned(150, "1", "candidates that are fitted while the ring is tracked", _LIVE)


@dataclass(frozen=True, slots=True)
class HypothesisSearch:
    """Similarities between image and ring from pairs of discs and pairs of balls."""

    longest_mm: float = tuned(48.0, "mm", "longest pair of balls", _IDENTIFICATION)
    shortest_mm: float = tuned(18.0, "mm", "shortest pair of discs", _IDENTIFICATION)
    scale_tolerance: float = tuned(0.18, "1", "largest logarithm of scale over nominal scale", _TEN_PER_CENT)
    image_pairs: int = tuned(90, "1", "pairs of discs that are tried", _IDENTIFICATION)
    clearest: int = tuned(220, "1", "discs of which pairs are made, the clearest first", _IDENTIFICATION)
    pairs_of_a_disc: int = tuned(3, "1", "most pairs of one disc", _IDENTIFICATION)
    neighbourhood_mm: float = tuned(45.0, "mm", "radius in which a hypothesis is scored", _IDENTIFICATION)
    reach_detector_mm: float = tuned(1.645, "mm", "distance at which a disc supports a predicted ball", _IDENTIFICATION)
    least_counted: int = tuned(6, "1", "predicted balls below which a score is not raised", _IDENTIFICATION)
    kept: int = tuned(4000, "1", "hypotheses that are kept", _IDENTIFICATION)
    same_angle_rad: float = tuned(0.08, "rad", "cell in which rotations are the same", _IDENTIFICATION)
    same_offset_mm: float = tuned(6.0, "mm", "cell in which offsets are the same", _IDENTIFICATION)


@dataclass(frozen=True, slots=True)
class GrowthStep:
    """One step of growing a hypothesis.

    Attributes
    ----------
    radius_mm
        Balls within this distance of the first one are matched.
    order
        Total order of the polynomial that is fitted to the matches.
    reach_detector_mm
        Largest distance of a match.
    """

    radius_mm: float
    order: int
    reach_detector_mm: float


@dataclass(frozen=True, slots=True)
class Identification:
    """Hypotheses grown over the ring while a polynomial learns the distortion."""

    grown: int = tuned(32, "1", "hypotheses that are grown", _IDENTIFICATION)
    least_discs: int = tuned(8, "1", "discs without which there is no identity", _IDENTIFICATION)
    least_matches: int = tuned(6, "1", "matches that every step needs", _IDENTIFICATION)
    smallest_log_radius: float = tuned(
        -0.85,
        "1",
        "least logarithm of measured over nominal radius",
        physical("bright air hides the rim of small balls"),
    )
    largest_log_radius: float = tuned(
        0.40, "1", "largest logarithm of measured over nominal radius", physical("nothing makes shadows much larger")
    )
    steps: tuple[GrowthStep, ...] = tuned(
        (
            GrowthStep(radius_mm=45.0, order=1, reach_detector_mm=1.645),
            GrowthStep(radius_mm=60.0, order=1, reach_detector_mm=1.645),
            GrowthStep(radius_mm=75.0, order=2, reach_detector_mm=1.41),
            GrowthStep(radius_mm=95.0, order=2, reach_detector_mm=1.41),
            GrowthStep(radius_mm=120.0, order=3, reach_detector_mm=1.41),
            GrowthStep(radius_mm=400.0, order=3, reach_detector_mm=1.175),
            GrowthStep(radius_mm=400.0, order=3, reach_detector_mm=0.705),
            GrowthStep(radius_mm=400.0, order=3, reach_detector_mm=0.5875),
        ),
        "mm",
        "radius, order and reach of each step",
        _IDENTIFICATION,
    )


@dataclass(frozen=True, slots=True)
class RingMeasurement:
    """The ring's balls measured where a first estimate places them."""

    drift_detector_mm: float = tuned(0.08225, "mm", "standard deviation of a well-predicted place", _BALLS)
    prediction_sigmas: float = tuned(
        4.0,
        "1",
        "factor on a prediction's deviation: it comes from the same pixels and must not outweigh the measurement",
        _CALIBRATION,
    )
    widest_drift_detector_mm: float = tuned(
        0.188, "mm", "largest such deviation: beyond, other things pass for lost balls", _CALIBRATION
    )
    reach_detector_mm: float = tuned(
        1.41,
        "mm",
        "surroundings that are used: they settle the background's slope",
        fitted("`python -m benchmarks.imaging.ball_detection`: 1.00 of the Cramer-Rao limit, 1.09 at 0.94 mm"),
    )
    radius_range: float = tuned(0.12, "1", "by which a radius may differ from others of its size", _BALLS)
    shrunk: float = tuned(
        0.85, "1", "measured over geometric radius where none was found", physical("a ball's rim absorbs little")
    )
    same_disc_detector_mm: float = tuned(0.47, "mm", "discs closer than this to a measured ball are that ball", _BALLS)


@dataclass(frozen=True, slots=True)
class DistortionModel:
    """Polynomial and Gaussian process, and the hyperparameters' search by restricted maximum likelihood."""

    order: int = tuned(3, "1", "total order of the polynomial", _CALIBRATION)
    amplitude_detector_mm: float = tuned(0.1175, "mm", "amplitude from which the search starts", _CALIBRATION)
    length: float = tuned(1.0, "half sizes", "correlation length from which it starts", _CALIBRATION)
    noise_factor: float = tuned(1.5, "1", "noise factor from which it starts", _CALIBRATION)
    length_range: tuple[float, float] = tuned(
        (0.25, 4.0), "half sizes", "range of the correlation length", _CALIBRATION
    )
    noise_range: tuple[float, float] = tuned(
        (0.2, 60.0), "1", "range of the noise factor: balls 0.2 mm off are 40 times the floor", _CALIBRATION
    )
    log_tolerance: float = tuned(0.1, "1", "logarithms and log-likelihoods this close are the same", _CALIBRATION)
    first_evaluations: int = tuned(
        20, "1", "likelihoods of the first estimate, which only places the balls", _CALIBRATION
    )
    evaluations: int = tuned(40, "1", "likelihoods of the second estimate", _CALIBRATION)
    next_evaluations: int = tuned(15, "1", "likelihoods after outliers are left out", _CALIBRATION)
    displaced_noise_factor: float = tuned(
        5.0, "1", "noise factor from which the balls are taken to lie beside their file's places", _RING_BALLS
    )
    displaced_amplitude: float = tuned(
        2.0, "noise", "amplitude from which the search then starts once more", _RING_BALLS
    )
    displaced_length: float = tuned(0.5, "half sizes", "correlation length from which it then starts", _RING_BALLS)
    displaced_evaluations: int = tuned(60, "1", "likelihoods of that search", _RING_BALLS)
    gauge_reach: float = tuned(
        0.25, "widths", "standard deviation of the weights of the ideal image's scale", _CALIBRATION
    )
    central_reach: float = tuned(
        0.2, "heights", "radius of the circle on which the distortion is checked", _CALIBRATION
    )
    nodes: int = tuned(32, "1", "grid spacings over the longer side of the image", derived("decision 0002"))
    beyond: float = tuned(
        2.0, "spacings", "distance outside an aperture up to which the grid is estimated", derived("splines")
    )


@dataclass(frozen=True, slots=True)
class OutlierRejection:
    """Balls that disagree with all the others."""

    sigmas: float = tuned(4.0, "1", "left-out residual that is too large to be noise", standard("4 sigma"))
    share_of_worst: float = tuned(0.6, "1", "balls this close to the worst are left out together", _CALIBRATION)
    least_balls: int = tuned(
        20, "1", "balls below which none is left out", derived("they give 40 equations for 23 unknowns")
    )
    least_deviation_detector_mm: float = tuned(
        0.0047,
        "mm",
        "floor of a ball's standard deviation",
        derived("a fiftieth of a pixel: errors of the disc's model"),
    )
    credible_detector_mm: float = tuned(0.282, "mm", "left-out residual up to which a disc is the ball", _CALIBRATION)
    uncertain_detector_mm: float = tuned(
        0.0705, "mm", "field's deviation beyond which that is not tested", _CALIBRATION
    )


@dataclass(frozen=True, slots=True)
class MotionBlur:
    """Smear of the balls by motion, from their second moments."""

    rim_from_detector_mm: float = tuned(0.5875, "mm", "from a ball's edge to where its background begins", _BALLS)
    rim_to_detector_mm: float = tuned(1.175, "mm", "from a ball's edge to where its background ends", _BALLS)
    least_balls: int = tuned(12, "1", "balls without which no smear is reported", _BALLS)


@dataclass(frozen=True, slots=True)
class RingTracking:
    """The ring measured where an earlier image showed it."""

    least_balls_kept: float = tuned(0.75, "1", "share of the earlier image's balls that must be there again", _LIVE)
    residual_growth: float = tuned(2.0, "1", "largest residual over that of the earlier image", _LIVE)
    residual_floor_detector_mm: float = tuned(0.01175, "mm", "residual below which that is not tested", _LIVE)
    beside_detector_mm: float = tuned(0.705, "mm", "from a ball's edge to the surroundings it is compared with", _LIVE)
    directions: int = tuned(8, "1", "places about a ball and in it", _LIVE)
    plate_half_side_mm: float = tuned(60.0, "mm", "half side of the square whose motion is measured", _QUALITY)
    plate_places: int = tuned(7, "1", "places along its sides", _QUALITY)
    shift_limit_mm: float = tuned(1.0, "mm", "shift of the ring that is reported", _QUALITY)
    turn_limit_deg: float = tuned(0.5, "°", "rotation of the ring that is reported", _QUALITY)


@dataclass(frozen=True, slots=True)
class StillFrames:
    """Frames that are averaged because nothing moves."""

    block_px: int = tuned(6, "px", "side of the blocks whose means are compared", _STILL)
    noise_sigmas: float = tuned(6.0, "1", "difference of a block that is not noise", _STILL)
    sampled_px: int = tuned(
        4, "px", "spacing of the pixels that show gain and span", derived("a sixteenth of the time")
    )
    darkest_percentile: float = tuned(1.0, "%", "lower end of the span of grey values", _STILL)
    brightest_percentile: float = tuned(99.0, "%", "upper end of the span of grey values", _STILL)
    correlated: float = tuned(3.0, "1", "noise of a block over that of independent pixels", _STILL)
    span: float = tuned(
        0.006, "1", "difference of a block that is always allowed, over the span of grey values", _STILL
    )
    moved_blocks: float = tuned(0.004, "1", "share of blocks that may differ: clocks and dose counters", _STILL)
    least_frames: int = tuned(3, "1", "frames that an average needs", _STILL)
    most_frames: int = tuned(64, "1", "frames after which an average is complete", derived("noise falls to an eighth"))


@dataclass(frozen=True, slots=True)
class QualityControl:
    """What a quality report calls a finding; it refuses no image."""

    shift_mm: float = tuned(0.05, "mm", "ball's distance from its place in the file that is reported", _QUALITY)
    shift_sigmas: float = tuned(5.0, "1", "the same in standard errors", standard("5 sigma"))
    median_scatter: float = tuned(1.25, "1", "scatter of a median over a mean's", standard("root of pi / 2"))
    plane_half_side_mm: float = tuned(80.0, "mm", "half side of the square on which distortion is compared", _QUALITY)
    plane_places: int = tuned(9, "1", "places along its sides", _QUALITY)
    worst_ball_mm: float = tuned(0.1, "mm", "change of a ball since the last report that is reported", _QUALITY)
    least_seen: float = tuned(0.5, "1", "share of the images that must show a ball", _QUALITY)
    least_images: int = tuned(3, "1", "images without which nothing is reported of a ball", _QUALITY)
    drift_detector_mm: float = tuned(0.141, "mm", "standard deviation of a ball that calibration left out", _QUALITY)
    contrast_to_sd: float = tuned(8.0, "1", "contrast of such a ball in standard deviations", _QUALITY)
    source_drift_mm: float = tuned(3.0, "mm", "motion of the focal spot that is reported", _QUALITY)
    distortion_drift_px: float = tuned(1.0, "px", "change of the distortion, rms, that is reported", _QUALITY)


@dataclass(frozen=True, slots=True)
class QualityPage:
    """How the quality report's page is drawn (`service/quality_page.py`)."""

    enlargement: float = tuned(300.0, "1", "arrows of balls over their residuals", _DRAWN)
    most_pictures: int = tuned(12, "1", "images that are shown", _DRAWN)
    width_px: int = tuned(480, "px", "width of a picture", _DRAWN)
    darkest_percentile: float = tuned(0.5, "%", "grey value that is drawn black", _DRAWN)
    brightest_percentile: float = tuned(99.5, "%", "grey value that is drawn white", _DRAWN)
    grid: int = tuned(21, "1", "places along each side where distortion is drawn", _DRAWN)
    known_px: float = tuned(
        0.5, "px", "deviation beyond which it is drawn faint", derived("limit of an image's distortion at a hole")
    )
    beside_ring_mm: float = tuned(12.0, "mm", "margin about the ring's balls", _DRAWN)


@dataclass(frozen=True, slots=True)
class ScreenCopies:
    """Grey images that were stored in colours (`devices/dicom_pixels.py`)."""

    coloured_levels: int = tuned(24, "levels", "difference of channels of a coloured pixel", _UNRECORDED)
    most_coloured: float = tuned(0.02, "1", "share of coloured pixels that is allowed: text", _UNRECORDED)


NOMINAL_VALUES = NominalValues()
RING_DETECTION = RingDetection()
HYPOTHESIS_SEARCH = HypothesisSearch()
IDENTIFICATION = Identification()
RING_MEASUREMENT = RingMeasurement()
DISTORTION_MODEL = DistortionModel()
OUTLIER_REJECTION = OutlierRejection()
MOTION_BLUR = MotionBlur()
RING_TRACKING = RingTracking()
STILL_FRAMES = StillFrames()
QUALITY_CONTROL = QualityControl()
QUALITY_PAGE = QualityPage()
SCREEN_COPIES = ScreenCopies()
SETTINGS = declared_groups(globals())

"""Tuned values of ball detection and measurement: unit, effect and provenance of each.

Lengths named `_detector_mm` become pixels of an image by `shared.xray.pixel_scale`. Kernels take values as arguments.
"""

from dataclasses import dataclass
from typing import Final

from shared.tuning import declared_groups, derived, fitted, physical, standard, tuned

# Of a normal distribution: the standard deviation over the median of absolute deviations.
DEVIATION_PER_MEDIAN: Final = 1.4826

_RING_IMAGES: Final = fitted("by inspection on the seeded images of `python -m benchmarks.imaging.ball_detection`")
_GUIDE_IMAGES: Final = fitted(
    "by inspection; commit b603b98: median entry error on the independent images 0.062 mm instead of 0.085 mm"
)
_APERTURES: Final = fitted("by inspection on the seeded images of `tests/unit/shared/xray/test_aperture.py`")
_INSPECTION: Final = fitted("by inspection; no run that compared alternatives is recorded")
_DESCENT: Final = fitted("by inspection: it changes the number of steps, not where they end")
_WITHIN_PATCH: Final = derived("guard: beyond, a disc is no longer the one that was found")
_AS_BUILT: Final = fitted(
    "by inspection, `distalock bench built_parts` and `processing --seeds fit`: rings as filed show 0.05 mm at most, "
    "in images of half the size; balls 0.07 mm off widen entries by 0.1 mm"
)
_DEAD = fitted("by inspection on images of `tests/unit/shared/xray/test_dead_pixels.py` and own scenes 30044-30063")


@dataclass(frozen=True, slots=True)
class ApertureSearch:
    """The usable area of an image: what is not the black surround of an aperture or of collimator blades."""

    reduction: int = tuned(2, "px", "side of the squares of which one pixel is read", derived("a quarter of the time"))
    darkest_percentile: float = tuned(0.5, "%", "grey value that is taken as the darkest", _INSPECTION)
    brightest_percentile: float = tuned(95.0, "%", "grey value that is taken as the brightest", _INSPECTION)
    opening_px: int = tuned(5, "reduced px", "side of the square that opens the area: no hairs", _INSPECTION)
    least_rim_points: int = tuned(40, "1", "rim points without which no circle is sought", _INSPECTION)
    rounds: int = tuned(6, "1", "circle fits with the worst points left out", _INSPECTION)
    kept_share: float = tuned(0.6, "1", "share of the rim points that each round keeps at least", _INSPECTION)
    dark_share: float = tuned(0.04, "1", "share of the span above the darkest that is surround", _APERTURES)
    least_surround: float = tuned(0.01, "1", "a smaller surround than this share of the image is none", _APERTURES)
    circle_residual_px: float = tuned(
        2.0, "px", "rim points within this distance lie on the circle", derived("the rim is sampled every second pixel")
    )
    least_on_circle: float = tuned(
        0.5, "1", "share of the rim that must lie on the circle", derived("blades and metal may hide up to half of it")
    )
    inset_px: int = tuned(
        2, "px", "strip along the rim that is left out", derived("the rim is sampled every second pixel")
    )


@dataclass(frozen=True, slots=True)
class DiscDetection:
    """First candidates: local maxima of the correlation with a disc, fitted one by one."""

    known_radii: float = tuned(
        0.6, "least radii", "distance from a known disc within which none is sought", _RING_IMAGES
    )
    sampled_px: int = tuned(8, "px", "spacing of the pixels that show that range", derived("thousands are enough"))
    peak_radii: float = tuned(0.7, "least radii", "reach within which a maximum is the largest", _RING_IMAGES)
    same_place_radii: float = tuned(0.5, "least radii", "fits closer than this are one disc", _RING_IMAGES)
    edge_steepness: float = tuned(0.6, "blurs", "scale of the logistic edge of the correlated disc", _RING_IMAGES)
    darkest_percentile: float = tuned(1.0, "%", "grey value scaled to 0 before the correlation", _INSPECTION)
    brightest_percentile: float = tuned(99.0, "%", "grey value scaled to 1", _INSPECTION)
    least_deviation: float = tuned(
        1e-3, "1", "floor of a window's deviation over that range", derived("below it there is nothing but rounding")
    )
    scale_step: float = tuned(1.35, "1", "ratio of neighbouring radii that are correlated", _RING_IMAGES)
    blur_detector_mm: float = tuned(
        0.3525,
        "mm",
        "blur of a shadow's edge before it is fitted",
        _RING_IMAGES,
    )
    blur_sd_detector_mm: float = tuned(0.188, "mm", "standard deviation of that blur", derived("half of it"))
    margin_detector_mm: float = tuned(0.705, "mm", "surroundings of a disc, beyond its edge", _RING_IMAGES)
    drift_detector_mm: float = tuned(
        0.3525, "mm", "standard deviation of a candidate's centre before the fit", _RING_IMAGES
    )
    radius_tolerance: float = tuned(0.25, "1", "relative standard deviation of its radius before the fit", _RING_IMAGES)
    coarse_radius_px: float = tuned(
        1.6,
        "px",
        "radius of the smallest disc in the reduced image",
        _RING_IMAGES,
    )
    fill_detector_mm: float = tuned(3.525, "mm", "how far the image is continued beyond its area", _RING_IMAGES)
    correlation: float = tuned(0.55, "1", "least correlation coefficient with a disc", _RING_IMAGES)
    contrast_to_noise: float = tuned(4.0, "1", "least contrast over the residual noise of the fit", _RING_IMAGES)
    contrast_to_sd: float = tuned(6.0, "1", "least contrast over its standard deviation", _RING_IMAGES)
    most_candidates: int = tuned(400, "1", "candidates that are fitted, best first", _RING_IMAGES)
    radius_low: float = tuned(0.5, "1", "least fitted radius, over the smallest one searched", _RING_IMAGES)
    radius_high: float = tuned(1.3, "1", "largest fitted radius, over the largest one searched", _RING_IMAGES)
    moved: float = tuned(0.75, "1", "largest move of a centre in the fit, over the radius", _RING_IMAGES)
    moved_detector_mm: float = tuned(0.47, "mm", "move of a centre that is always accepted", _RING_IMAGES)


@dataclass(frozen=True, slots=True)
class DiscFitting:
    """Least-squares fit of blurred discs on a curved background, in normalised grey values."""

    huber: float = tuned(2.5, "1", "residual in standard deviations beyond which a pixel counts less", _RING_IMAGES)
    opacity: float = tuned(
        0.8,
        "1",
        "share of the background's variation that a ball hides",
        physical(
            "2-3 mm of steel transmit 2-6 %, plus scatter and glare; on a display curve of power 0.65 a fifth; the "
            "centres hardly depend on it between 0.7 and 1"
        ),
    )
    contrast: float = tuned(1.5, "1", "contrast from which a fit starts", _RING_IMAGES)
    overlap: float = tuned(
        0.8, "1", "share of the fainter of two shadows that vanishes under the darker one", _RING_IMAGES
    )
    overlap_sd: float = tuned(0.3, "1", "standard deviation of that share", _RING_IMAGES)
    curvature_precision: float = tuned(1.0, "1", "inverse variance of the background's curvature", _RING_IMAGES)
    least_pixels: int = tuned(30, "1", "pixels that a fit needs beyond four for each disc", _RING_IMAGES)
    first_iterations: int = tuned(12, "1", "most Levenberg steps before pixels are weighted", _RING_IMAGES)
    next_iterations: int = tuned(8, "1", "most Levenberg steps after each weighting", _RING_IMAGES)
    passes: int = tuned(2, "1", "rounds of weighting against pixels of other things", _RING_IMAGES)
    first_noise: float = tuned(0.05, "1", "noise that scales the priors' weight in the first descent", _RING_IMAGES)
    least_noise: float = tuned(1e-4, "1", "floor of the noise", derived("guard: a rendered image may have none"))
    neighbour_sigmas: float = tuned(3.0, "sd", "residuals whose neighbours show the noise's correlation", _RING_IMAGES)
    least_radius: float = tuned(0.4, "1", "smallest radius in the descent, over the one sought", _WITHIN_PATCH)
    greatest_radius: float = tuned(1.6, "1", "largest radius in the descent, over the one sought", _WITHIN_PATCH)
    greatest_overlap: float = tuned(
        1.2, "1", "largest overlap of two shadows", derived("guard: between their sum and their union")
    )
    least_blur_px: float = tuned(0.4, "px", "smallest blur", derived("guard: stays positive"))
    greatest_blur_px: float = tuned(4.0, "px", "largest blur", _WITHIN_PATCH)
    first_damping: float = tuned(1e-3, "1", "first damping, and least one after a step that failed", _DESCENT)
    singular_factor: float = tuned(10.0, "1", "rise of the damping of a singular matrix", standard("Marquardt 1963"))
    failed_factor: float = tuned(8.0, "1", "rise of the damping after a step that failed", _DESCENT)
    gained_factor: float = tuned(0.15, "1", "change of the damping after a step that gained", _DESCENT)
    greatest_damping: float = tuned(1e3, "1", "damping that ends a descent", derived("a thousandth of Newton's step"))
    least_gain: float = tuned(1e-4, "1", "relative fall of the cost that ends a descent", _DESCENT)


@dataclass(frozen=True, slots=True)
class BallMeasuring:
    """Balls measured where they are predicted, together with the discs that they touch."""

    reach_detector_mm: float = tuned(0.8225, "mm", "surroundings that are used, beyond a ball's edge", _RING_IMAGES)
    drift_detector_mm: float = tuned(0.235, "mm", "standard deviation of a predicted place", _RING_IMAGES)
    radius_tolerance: float = tuned(0.15, "1", "relative standard deviation of a predicted radius", _RING_IMAGES)
    blur_detector_mm: float = tuned(0.3525, "mm", "blur of edges before a fit", _RING_IMAGES)
    blur_sd_detector_mm: float = tuned(0.188, "mm", "standard deviation of that blur", derived("half of it"))
    contrast_to_sd: float = tuned(4.0, "1", "least contrast to be seen, in standard deviations", _RING_IMAGES)
    drift_sigmas: float = tuned(
        4.0,
        "1",
        "largest drift from the prediction, in standard deviations",
        standard("4 sigma"),
    )
    touch_detector_mm: float = tuned(
        0.5875, "mm", "gap between two edges below which discs are fitted together", _RING_IMAGES
    )
    loosening_detector_mm: float = tuned(
        0.17625, "mm", "step by which that gap shrinks while a group is too large", _RING_IMAGES
    )
    keep_out_detector_mm: float = tuned(
        0.47, "mm", "strip around discs of other groups that does not count", _RING_IMAGES
    )
    largest_group: int = tuned(5, "1", "most discs of one fit", derived("22 parameters; time grows with their cube"))
    same_disc_radii: float = tuned(0.6, "1", "discs closer than this share of the radius are the same", _RING_IMAGES)
    same_disc_detector_mm: float = tuned(0.47, "mm", "discs closer than this are the same", _RING_IMAGES)


@dataclass(frozen=True, slots=True)
class HiddenBalls:
    """Balls that detection missed because another one covers them in part."""

    centre_stiffness: float = tuned(0.25, "1", "factor on centres' deviations during the search", _RING_IMAGES)
    stiff_radius: float = tuned(0.04, "1", "relative deviation of radii during the search", _RING_IMAGES)
    moved_sigmas: float = tuned(0.4, "1", "move of a centre, in deviations, that starts a search", _RING_IMAGES)
    grown: float = tuned(0.1, "1", "relative growth of a radius that starts a search", _RING_IMAGES)
    dark_spot_sigmas: float = tuned(5.0, "1", "least significance of a dark spot", standard("5 sigma"))
    most: int = tuned(2, "1", "balls that may join a group", _RING_IMAGES)
    drift_detector_mm: float = tuned(0.47, "mm", "standard deviation of a joining ball's place", _RING_IMAGES)
    radius_tolerance: float = tuned(0.2, "1", "relative standard deviation of its radius", _RING_IMAGES)
    least_apart: float = tuned(0.5, "1", "least distance from the other balls, over the radius", _RING_IMAGES)
    least_strength: float = tuned(8.0, "1", "least contrast over its standard deviation", _RING_IMAGES)
    least_contrast: float = tuned(0.4, "1", "least contrast over that of the darkest other ball", _RING_IMAGES)
    least_gain: float = tuned(25.0, "1", "least fall of the squared residuals, in noise variances", standard("5 sigma"))
    most_correlated: float = tuned(
        0.9, "1", "largest correlation of neighbouring noise", derived("the noise factor's sum holds below it")
    )
    typical_quantile: float = tuned(
        0.35, "1", "quantile of the patches' correlations that is taken for the image", _RING_IMAGES
    )


@dataclass(frozen=True, slots=True)
class NoiseWhitening:
    """Inverse filter against correlated noise, learned from flat blocks of the image itself, in its own pixels."""

    flattest: float = tuned(0.2, "1", "share of the blocks with the least structure that show the noise", _GUIDE_IMAGES)
    least_blocks: int = tuned(20, "1", "blocks without which no filter is made", _GUIDE_IMAGES)
    most_clipped: float = tuned(
        0.01,
        "1",
        "largest clipped share of a block",
        fitted("commit db68189: clipped blocks held rounding errors"),
    )
    ring_width: float = tuned(
        0.04,
        "cycles/px",
        "width of the spectrum's averaging rings",
        derived("1.3 lines of a 32 px block"),
    )
    slow: float = tuned(0.08, "cycles/px", "below, bone outweighs the noise and the gain is one", _GUIDE_IMAGES)
    slow_end: float = tuned(0.16, "cycles/px", "end of the band whose power is the reference", derived("an octave"))
    least_power: float = tuned(
        0.01, "1", "floor of the relative power", derived("limits the gain to ten; beyond, the pixel grid shows")
    )
    kernel_reach_px: int = tuned(8, "px", "half width of the filter's kernel", derived("a quarter of a 32 px block"))


@dataclass(frozen=True, slots=True)
class DeadPixels:
    """Pixels that do not answer (`shared/xray/dead_pixels.py`)."""

    neighbourhood_px: int = tuned(
        5, "px", "side of the square whose median a pixel is compared with", derived("one line is less than half of it")
    )
    darkest_percentile: float = tuned(1.0, "%", "lower end of the image's range of grey", _DEAD)
    brightest_percentile: float = tuned(99.0, "%", "upper end of the image's range of grey", _DEAD)
    noise_window_px: int = tuned(31, "px", "side of the square that shows the noise", _DEAD)
    limit_in_spreads: float = tuned(
        10.0, "mean deviations", "deviation beyond structure of a dead pixel", derived("eight standard deviations")
    )
    least_share_of_range: float = tuned(0.03, "1", "the same, as a share of the image's range of grey", _DEAD)
    dead_share_of_line: float = tuned(0.4, "1", "share of dead pixels from which a whole line is dead", _DEAD)


@dataclass(frozen=True, slots=True)
class BallsAsBuilt:
    """Balls beside their file's places: from where a refusal names them as its cause (`shared/parts/as_built.py`)."""

    ring_named_from_mm: float = tuned(0.07, "mm", "spread of the ring's balls, per axis", _AS_BUILT)
    guide_named_from_mm: float = tuned(0.05, "mm", "spread of the guide's balls, per axis", _AS_BUILT)


APERTURE_SEARCH = ApertureSearch()
BALLS_AS_BUILT = BallsAsBuilt()
DEAD_PIXELS = DeadPixels()
DISC_DETECTION = DiscDetection()
DISC_FITTING = DiscFitting()
BALL_MEASURING = BallMeasuring()
HIDDEN_BALLS = HiddenBalls()
NOISE_WHITENING = NoiseWhitening()
SETTINGS = declared_groups(globals())

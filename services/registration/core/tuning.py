"""Every tuned value of registration's core, with its unit, its effect and where it comes from.

One frozen dataclass per stage with one instance in capitals, read where it is used. `docs/tuning.md` is printed from
`SETTINGS`, and `distalock bench sensitivity` varies each value.
"""

from dataclasses import dataclass
from typing import Final

from shared.tuning import declared_groups, derived, fitted, physical, standard, tuned

_SCENES: Final = "by inspection on seeded scenes of `benchmarks.scenes.random_scenes`"
_AS_BUILT: Final = fitted("`distalock bench built_parts --seeds fit` and plain images")
_OTHER_RING: Final = fitted(
    "seeds 60600-60639, plain and `ring_plates_nearer`: entry errors over predicted 0.88 and 1.9 rms (decision 0021)"
)
_INSPECTION: Final = fitted(f"{_SCENES}; no run that compared alternatives is recorded")
_ON_INDEPENDENT: Final = fitted(
    "28 independent images, `python -m benchmarks.accuracy.nail_fit`; alternatives in docs/nail-likelihood.md"
)
_SMOOTHED_SEARCH: Final = fitted(
    "16 starts an image, `python -m benchmarks.accuracy.capture`: one or two end points, without smoothing up to 9"
)
_EDGE_REACH: Final = derived("half a diagonal 0.7, softening 0.15, curvature: pixels change by 0.003 (1.0: by 0.009)")
_CUT: Final = derived("cut at 1.5 sd: bias a thirtieth of the noise")
_STRAIGHT: Final = derived("assumed 0.3 mm over 180 mm: 8 * 0.3 / 180^2")
_MUSCLE: Final = physical("60-80 kV behind 100-200 mm of muscle")
_SPECTRUM_END: Final = physical("end of the spectrum at 60-80 kV: law off by 0.08 % at most")
_FOREIGN: Final = fitted("by inspection on scenes of `distalock bench foreign_objects --seeds fit`")
_EVIDENT: Final = fitted(
    "seeds 60000-60006 (decision 0019): metal 0.36 to 1.42 but for one 0.31, filters at most 0.23, local contrast 0.45"
)
_BESIDE: Final = fitted("by inspection: ten refused or far off of seeds 60007-60014, plate 60026 (decision 0019)")
_FILTERED: Final = fitted("`distalock bench processing --seeds fit --count 12`: bilateral filter and local contrast")
_CONTENT: Final = fitted(
    "holes that hold bone, dust or bores, seeds 60500-60544, and plain independent images, as they are and with bores "
    "(decision 0063)"
)
_METAL: Final = fitted(
    "plain independent images: 0.25 at most; with the other metal in the file, where that does not refuse them: 0.6 to "
    "1.4 (decision 0063)"
)
_TAILS: Final = fitted("by inspection: seeds 60000-60023, plain and through three filters (decision 0018)")
_PROCESSED: Final = fitted("by inspection: seeds 30024-30063 through local contrast and filters (decision 0018)")
_CURVED: Final = fitted("`distalock bench processing --seeds fit`: local contrast, monitor chain (decision 0045)")
_CURVE_LEFT: Final = fitted(
    "`distalock bench processing --kind local_contrast --kind monitor_chain --seeds fit --skip 100 --count 12` "
    "(decision 0045)"
)
_CHAMFERS: Final = fitted("by inspection: `distalock bench bent_nails --kind chamfers --seeds fit` (decision 0062)")
_AS_GOOD: Final = fitted("by inspection: one evaluation image, and 25 of other seeds (decision 0045)")
_TOLERANCE: Final = physical("manufacturing tolerance, assumed")
_ABANDONED: Final = fitted("65 abandoned fits, 30 scenes, `python -m benchmarks.accuracy.capture`: up to 4 occurred")
_KEPT: Final = fitted("7 seeded scenes: the fit ends 0.03 standard deviations away at most (docs/nail-likelihood.md)")
_NINE_PX: Final = fitted("seeds 30000-30239, `distalock bench accuracy`: 11 px accept the same 235, a third slower")
_REACH_OF_NOISE: Final = fitted(
    "7 seeded scenes, 8 draws of noise each, `python -m benchmarks.accuracy.noise_draws`: 7 px leave a variance factor "
    "of 2.9 instead of 2.1"
)


# The nail's global search


@dataclass(frozen=True, slots=True)
class NailBandSearch:
    """The nail as a dark band, on a reduced image (`core/nail/search/band.py`); lengths there in search pixels."""

    band_width_px: float = tuned(30.0, "search px", "width to which the image reduces a nail", _INSPECTION)
    nearest_to_detector_mm: float = tuned(80.0, "mm", "nearest nail to the ring's near plate", _INSPECTION)
    farthest_from_detector_mm: float = tuned(350.0, "mm", "nail farthest from the ring's near plate", _INSPECTION)
    lowest_grey_percentile: float = tuned(0.5, "%", "grey value scaled to 0", _INSPECTION)
    highest_grey_percentile: float = tuned(99.0, "%", "grey value scaled to 1", _INSPECTION)
    reduction_blur: float = tuned(0.5, "search px", "Gaussian before reduction", derived("half a pixel: no aliasing"))
    border_px: float = tuned(2.0, "search px", "margin of border and aperture", _INSPECTION)
    map_step_px: int = tuned(16, "search px", "spacing of exact distortion", derived("smooth: linear between them"))
    nearest_to_source_mm: float = tuned(100.0, "mm", "nearest nail to the focal spot", physical("the tube's housing"))
    edge_border_px: int = tuned(3, "search px", "margin without edges", derived("gradient and smoothing reach so far"))
    lower_threshold: float = tuned(0.5, "1", "lower edge threshold over the upper", standard("Canny 1986: 1/3 to 1/2"))
    gradient_levels: float = tuned(8000.0, "1", "steepest gradient in 16 bits", derived("squares fit into 31 bits"))
    gradient_smoothing_px: float = tuned(1.2, "search px", "Gaussian before the gradient", _INSPECTION)
    edge_share: float = tuned(0.12, "1", "share of the pixels above the upper edge threshold", _INSPECTION)
    full_weight_quantile: float = tuned(0.985, "1", "gradient from which an edge pixel has full weight", _INSPECTION)
    direction_spread_deg: int = tuned(4, "°", "spread of an edge pixel's vote over directions", _INSPECTION)
    shortest_edge_in_widths: float = tuned(1.2, "band widths", "shortest edge of a band", _INSPECTION)
    suppressed_deg: int = tuned(8, "°", "directions about a band without another", _INSPECTION)
    suppressed_in_widths: float = tuned(0.35, "band widths", "distance about a band without another", _INSPECTION)
    most_bands: int = tuned(6, "1", "bands in which holes are searched", _INSPECTION)
    least_darkness: float = tuned(0.06, "1", "darkness of a band in which holes are searched", _INSPECTION)
    edge_length_weight: float = tuned(0.2, "1/band widths", "weight of an edge's length against holes", _INSPECTION)


@dataclass(frozen=True, slots=True)
class NailHoleSearch:
    """Holes along a band (`core/nail/search/holes.py`)."""

    least_scale: float = tuned(0.86, "1", "least scale along the band over that of its width", _INSPECTION)
    largest_scale: float = tuned(1.12, "1", "largest scale along the band over that of its width", _INSPECTION)
    scales: int = tuned(27, "1", "scales tried", derived("steps of 1 %"))
    band_half_height: float = tuned(1.1, "band widths", "half height of the straightened image", _INSPECTION)
    metal_from: float = tuned(0.27, "band widths", "from the middle: metal is sampled, begin", _INSPECTION)
    metal_to: float = tuned(0.4, "band widths", "metal is sampled, end", derived("inside the edge at 0.5"))
    beside_from: float = tuned(0.62, "band widths", "surroundings sampled, begin", derived("beyond the edge at 0.5"))
    beside_to: float = tuned(0.9, "band widths", "surroundings sampled, end", _INSPECTION)
    clear_quantile: float = tuned(
        0.8,
        "1",
        "quantile of the darkness along a band taken for that of its parts in the clear",
        fitted("`distalock bench foreign_objects --seeds fit`"),
    )
    lateral_reach: float = tuned(0.1, "band widths", "how far from the middle line a hole may lie", _INSPECTION)
    disc_in_radii: float = tuned(0.75, "hole radii", "disc whose mean is an opening's brightness", _INSPECTION)
    side_disc_in_radii: float = tuned(0.35, "hole radii", "disc whose mean is the metal beside it", _INSPECTION)
    side_distance_in_radii: float = tuned(1.45, "hole radii", "distance of that metal from the centre", _INSPECTION)
    least_darkness: float = tuned(0.02, "1", "floor of the darkness by which contrasts are divided", _INSPECTION)
    beyond_open: float = tuned(0.1, "1", "weight of excess brightness", derived("breaks ties; a dim hole still counts"))
    tip_before_from_mm: float = tuned(8.0, "mm", "metal before the tip, begin", _INSPECTION)
    tip_before_to_mm: float = tuned(4.0, "mm", "metal before the tip, end", _INSPECTION)
    tip_after_from_mm: float = tuned(3.0, "mm", "no metal after the tip, begin", _INSPECTION)
    tip_after_to_mm: float = tuned(9.0, "mm", "no metal after the tip, end", _INSPECTION)
    reference_reach_px: int = tuned(12, "search px", "about the origin: reference of darkness", _INSPECTION)


@dataclass(frozen=True, slots=True)
class OpeningOutline:
    """Outline of a hole's opening in the image as received (`core/nail/search/outline.py`)."""

    directions: int = tuned(96, "1", "rays from the centre", _INSPECTION)
    step_detector_mm: float = tuned(0.1175, "mm", "spacing of samples along a ray", derived("half a usual pixel"))
    smoothing_detector_mm: float = tuned(0.235, "mm", "Gaussian before sampling", _INSPECTION)
    smoothing_reach_detector_mm: float = tuned(1.41, "mm", "margin of smoothing", derived("six sd of it"))
    reach_in_radii: float = tuned(1.45, "hole radii", "how far from the centre the outline is searched", _INSPECTION)
    centre_off_in_reaches: float = tuned(2.0, "reaches", "half the section about it", derived("centre and reach"))
    inner_in_radii: float = tuned(1.3, "hole radii", "largest distance of a crossing", _INSPECTION)
    bright_within_radii: float = tuned(0.55, "hole radii", "disc that shows the opening's grey value", _INSPECTION)
    bright_percentile: float = tuned(70.0, "%", "of that disc: the opening's grey value", _INSPECTION)
    dark_beyond_radii: float = tuned(1.15, "hole radii", "from where metal shows its grey value", _INSPECTION)
    dark_percentile: float = tuned(25.0, "%", "of what lies beyond: metal's grey", derived("the edge is near"))
    least_points: int = tuned(16, "1", "fewest points of an outline", _INSPECTION)
    rounds: int = tuned(6, "1", "ellipse fits with outliers left out", _INSPECTION)
    extent_percentile: float = tuned(4.0, "%", "of the crossings per axis: an end of the outline", _INSPECTION)
    first_tolerance_sd: float = tuned(3.0, "sd", "residual tolerated in the first round", standard("3 sigma"))
    tolerance_step_sd: float = tuned(0.4, "sd", "by how much it falls with each round, to 1 sd", _INSPECTION)
    outer_tolerance: float = tuned(1.5, "1", "tolerance outwards over inwards: balls lie inside", _INSPECTION)
    least_tolerance_detector_mm: float = tuned(0.235, "mm", "residual always tolerated", derived("a usual pixel"))
    least_semi_axis_in_radii: float = tuned(0.35, "hole radii", "smallest major semi-axis", _INSPECTION)
    largest_semi_axis_in_radii: float = tuned(1.5, "hole radii", "largest major semi-axis", _INSPECTION)


@dataclass(frozen=True, slots=True)
class NailContour:
    """The nail's two edges beside its holes."""

    beyond_holes_mm: float = tuned(10.0, "mm", "length beyond the outer holes with fitted edges", _INSPECTION)
    reach_in_widths: float = tuned(0.16, "band widths", "distance from the proposed edge that is searched", _INSPECTION)
    share_of_steepest: float = tuned(
        0.5, "1", "slope of an edge over the steepest near it", fitted("`distalock bench processing --seeds fit`")
    )
    smoothing_px: float = tuned(1.0, "search px", "Gaussian before the slope", _INSPECTION)
    outlier_deviations: float = tuned(2.5, "sd", "a point is left out", standard("robust line fit"))
    least_deviation_px: float = tuned(0.3, "search px", "floor of that standard deviation", _INSPECTION)
    rounds: int = tuned(6, "1", "line fits with outliers left out", _INSPECTION)


@dataclass(frozen=True, slots=True)
class OpeningCover:
    """What covers an opening and is neither guide nor ball: a wire, a drill, an instrument."""

    inside_rim_detector_mm: float = tuned(0.47, "mm", "distance from the rim: cover counts", _INSPECTION)
    open_detector_mm: float = tuned(0.705, "mm", "distance from the rim: opening is sampled", _INSPECTION)
    metal_from_detector_mm: float = tuned(0.94, "mm", "metal around the rim, begin", _INSPECTION)
    metal_to_detector_mm: float = tuned(2.35, "mm", "metal around the rim, end", _INSPECTION)
    bright_percentile: float = tuned(70.0, "%", "of the opening: its grey value", _INSPECTION)
    dark_percentile: float = tuned(20.0, "%", "of the metal: its grey value", _INSPECTION)
    dark_share: float = tuned(0.55, "1", "level from metal (0) to opening (1) of a covered pixel", _INSPECTION)
    least_pixels: int = tuned(6, "1", "fewest covered pixels that count", _INSPECTION)
    reach_mm: float = tuned(1.45, "mm", "margin around the cover that is left out of the fit", _INSPECTION)
    ball_margin_detector_mm: float = tuned(0.47, "mm", "margin around known balls", _INSPECTION)


# The nail's fit: what is compared


@dataclass(frozen=True, slots=True)
class FitRegionSettings:
    """Which pixels take part in the fit (`core/nail/region.py`)."""

    kernel_reach: float = tuned(4.0, "sd", "half length of a blur's kernel", derived("its end is 0.04 % of its middle"))
    blur_reach_px: int = tuned(8, "stage px", "rendered margin for the blur", derived("3 sd of the usual tail, 2.6 px"))
    aperture_margin_detector_mm: float = tuned(2.115, "mm", "margin inside the aperture", _INSPECTION)
    white_percentile: float = tuned(95.0, "%", "grey value that is taken as brightness 1", _INSPECTION)
    least_pixels: int = tuned(200, "image px", "fewest pixels of a fit", derived("ten times the fitted parameters"))
    shadow_stretch: float = tuned(0.3, "1", "excess of a ball's shadow over it", derived("distortion, obliquity"))
    least_side_px: int = tuned(8, "stage px", "least side of a region", derived("guard: rays need a gradient"))
    wire_discs: int = tuned(200, "1", "discs along a wire's image", derived("neighbours overlap by half"))
    wire_reach_mm: float = tuned(0.5, "mm", "margin around wires in which their paths are traced", _INSPECTION)
    fill_blur_px: float = tuned(4.0, "px", "spread of background into hidden pixels", derived("half the blur's reach"))


@dataclass(frozen=True, slots=True)
class RaySampling:
    """How finely rays are traced (`core/nail/attenuation.py`)."""

    edge_reach_px: float = tuned(1.5, "stage px", "distance from an edge that needs several rays", _EDGE_REACH)
    uniform_difference: float = tuned(0.02, "1", "spread of four rays that suffice", _INSPECTION)
    softening_px: float = tuned(0.15, "stage px", "half width of mean at grazed surfaces", _INSPECTION)
    near_edge_in_steps: float = tuned(5.0, "steps", "from edges: analytic derivatives", derived("differences agree"))


@dataclass(frozen=True, slots=True)
class BeamPhysics:
    """Beam, materials and focal spot."""

    steel_attenuation_per_mm: float = tuned(1.6, "1/mm", "mean attenuation of steel", _MUSCLE)
    titanium_attenuation_per_mm: float = tuned(0.5, "1/mm", "mean attenuation of Ti6Al4V", _MUSCLE)
    hardest_share: float = tuned(0.4, "1", "attenuation of hardest X-rays over mean", _SPECTRUM_END)
    focal_spot_mm: float = tuned(0.5, "mm", "edge of the focal spot", physical("0.3 to 0.6; docs/nail-likelihood.md"))
    least_spread: float = tuned(0.2, "stage px", "least spread of a pixel's rays", derived("equal rays would jump"))


# The nail's fit: priors


@dataclass(frozen=True, slots=True)
class NailPriors:
    """Means and standard deviations before an image is seen (`core/nail/parameters.py`)."""

    radius_sd_mm: float = tuned(0.03, "mm", "of hole and nail radius about the part file's", _TOLERANCE)
    largest_radius_excess_mm: float = tuned(0.6, "mm", "bound of both", derived("exposes another nail size"))
    usual_chamfer_mm: float = tuned(0.15, "mm", "chamfer depth if the file has none", physical("rims are deburred"))
    usual_chamfer_sd_mm: float = tuned(0.15, "mm", "of that depth", physical("deburred to countersunk"))
    usual_chamfer_chi_square: float = tuned(
        3.0, "1", "chi-square of a deeper chamfer up to which that prior holds", _CHAMFERS
    )
    stated_chamfer_sd_mm: float = tuned(0.05, "mm", "of a stated depth", _TOLERANCE)
    log_attenuation_sd: float = tuned(0.5, "1", "of the logarithm of the attenuation", _INSPECTION)
    hardening: float = tuned(0.65, "1", "relative variance of attenuation", physical("spectra, 64-76 kV (unit test)"))
    hardening_sd: float = tuned(0.3, "1", "of that", physical("tube voltage and thickness of the leg"))
    blur_detector_mm: float = tuned(0.282, "mm", "standard deviation of the detector's blur", _INSPECTION)
    log_blur_sd: float = tuned(0.35, "1", "of its logarithm", _INSPECTION)
    tail_share: float = tuned(0.2, "1", "share of the blur's tail", _INSPECTION)
    tail_share_sd: float = tuned(0.15, "1", "of that", _INSPECTION)
    largest_tail_share: float = tuned(0.8, "1", "bound of it", _INSPECTION)
    tail_width: float = tuned(2.2, "blur widths", "width of the tail", _INSPECTION)
    log_tail_width_sd: float = tuned(0.2, "1", "of its logarithm", _INSPECTION)
    sharpening: float = tuned(0.2, "1", "strength of the edge enhancement", _INSPECTION)
    sharpening_sd: float = tuned(0.4, "1", "of that", _INSPECTION)
    sharpening_detector_mm: float = tuned(0.5875, "mm", "width of the edge enhancement", _INSPECTION)
    log_sharpening_width_sd: float = tuned(0.4, "1", "of its logarithm", _INSPECTION)
    curve: float = tuned(0.3, "1", "bend of the display's curve", _INSPECTION)
    curve_sd: float = tuned(0.3, "1", "of that", _INSPECTION)
    curve_exponent: float = tuned(0.4, "1", "exponent of that curve", derived("between logarithm 0 and linear 1"))
    curve_exponent_sd: float = tuned(0.25, "1", "of that", _INSPECTION)
    least_exponent: float = tuned(-0.4, "1", "bound of the exponent", derived("displays: logarithm 0, linear 1"))
    largest_exponent: float = tuned(0.9, "1", "bound of the exponent", derived("at 1 the curve has no bend"))
    bulge_sd: float = tuned(0.15, "1", "the display's further bend, at the middle of an edge", _PROCESSED)
    s_bend_sd: float = tuned(0.15, "1", "the same, opposite at the edge's dark and bright half", _PROCESSED)
    delrin_per_mm: float = tuned(0.02, "1/mm", "attenuation of the guide's body", physical("POM at 60-80 kV"))
    delrin_per_mm_sd: float = tuned(0.02, "1/mm", "of that", physical("from none to twice that of POM: guides differ"))
    straightness_sd_per_m: float = tuned(0.07, "1/m", "curvature of a nail as made, each plane", _STRAIGHT)
    bent_sd_per_m: float = tuned(
        2.0, "1/m", "of a nail bent by the canal, each plane", derived("radius 300 mm: 1.7 sd")
    )
    least_anchor_distance_mm: float = tuned(5.0, "mm", "holes closer than this are one place", _INSPECTION)
    usual_anchor_mm: float = tuned(15.0, "mm", "anchors from the origin then", physical("usual holes are 30 mm apart"))
    largest_deviations: float = tuned(6.0, "sd", "bound of all other parameters", standard("six sigma"))


# The nail's fit: noise


@dataclass(frozen=True, slots=True)
class NailNoise:
    """Noise estimated from residuals (`core/nail/noise.py`); lengths in pixels of the stage."""

    assumed_sd: float = tuned(0.025, "1", "noise over brightness before residuals are known", _INSPECTION)
    clipped_deviations: float = tuned(4.0, "sd", "residuals beyond it count as so much", _INSPECTION)
    brightness_blur_px: float = tuned(1.5, "stage px", "blur of the map of brightness", _INSPECTION)
    least_of_a_kind: int = tuned(400, "stage px", "fewest pixels with a correlation of their own", _INSPECTION)
    largest_lag_px: int = tuned(9, "stage px", "largest lag of the correlation", _REACH_OF_NOISE)
    taper_px: float = tuned(8.0, "stage px", "lag where correlation is tapered to 0", derived("within the largest lag"))
    filter_reach_px: float = tuned(9.0, "stage px", "reach of the whitening filter", _REACH_OF_NOISE)
    lowest_frequency: float = tuned(0.06, "1/px", "below it the gain is one", derived("slow residuals: texture, too"))
    power_floor: float = tuned(0.002, "1", "power added before inversion", derived("limits the filter's gain to 22"))
    brightness_classes: int = tuned(12, "1", "classes of the variance by brightness", _INSPECTION)
    least_of_a_class: int = tuned(24, "stage px", "fewest pixels with a variance of their own", _INSPECTION)
    least_variance_share: float = tuned(0.001, "1", "least variance of a class over the largest", _INSPECTION)
    outlier_deviations: float = tuned(3.0, "sd", "beyond it residuals weigh less", standard("Huber's estimator"))


# The nail's fit: whether the parts of the evidence agree


@dataclass(frozen=True, slots=True)
class AgreementOfParts:
    """Sectors of rims and stretches of edges, and what their disagreement does (`core/nail/evidence.py`)."""

    sectors: int = tuned(8, "1", "sectors about a hole", _INSPECTION)
    about_rim_in_radii: float = tuned(1.45, "hole radii", "reach of the sectors", _INSPECTION)
    inside_nail_in_radii: float = tuned(0.97, "nail radii", "beyond, pixels belong to the nail's edge", _INSPECTION)
    stretches: int = tuned(5, "1", "stretches of either edge of the nail", _INSPECTION)
    parts_that_agree: float = tuned(4.0, "parts", "prior count of parts that pull as predicted", _PROCESSED)
    usual_bulge: float = tuned(0.1, "1", "bulge of the display's curve that plain images have too", _PROCESSED)
    bulge_of_one_deviation: float = tuned(0.2, "1", "bulge beyond it that doubles the variance", _PROCESSED)
    largest_bulge_excess: float = tuned(0.3, "1", "bulge beyond the usual one that counts", _PROCESSED)
    usual_shape: float = tuned(0.7, "sd", "deviation of the radii that plain images have too", _PROCESSED)
    shape_of_one_deviation: float = tuned(0.3, "sd", "deviation beyond it that doubles the variance", _PROCESSED)
    usual_scale_excess: float = tuned(0.003, "1", "scale beside the file's that plain images have too", _PROCESSED)
    usual_noise_inflation: float = tuned(4.0, "px", "correlation of the noise that plain images have too", _PROCESSED)
    inflation_of_one_deviation: float = tuned(1.3, "px", "correlation beyond it that doubles the variance", _PROCESSED)
    usual_softness: float = tuned(1.3, "sd", "hardening below the usual that plain images have too", _PROCESSED)
    softness_of_one_deviation: float = tuned(1.0, "sd", "softness beyond it that doubles the variance", _PROCESSED)
    usual_sharpening: float = tuned(2.0, "sd", "edge enhancement that plain images have too", _PROCESSED)
    sharpening_of_one_deviation: float = tuned(1.0, "sd", "sharpening beyond it that doubles the variance", _PROCESSED)
    usual_metal: float = tuned(
        0.5, "1", "logarithm of the metal's attenuation over its material's that plain images have too", _METAL
    )
    metal_of_one_deviation: float = tuned(0.1, "1", "the same beyond it that doubles the variance", _METAL)
    usual_tails: float = tuned(1.05, "1", "variance of residuals over that by their median in plain images", _TAILS)
    largest_deviation: float = tuned(4.0, "sd", "residual that is counted as no larger for this", _TAILS)
    processed_from: float = tuned(2.5, "1", "growth of the variance from where an image counts as processed", _FILTERED)
    processed_sd_deg: float = tuned(0.3, "°", "error of a tilt by processing, whatever the noise", _FILTERED)


@dataclass(frozen=True, slots=True)
class DisplayCurveFit:
    """The display's curve by place (`core/nail/display_curve.py`); steps are those from metal to background."""

    turn_deg: float = tuned(4.5, "°", "turn of the nail by a curve that changes by the levels' range", _CURVE_LEFT)
    largest_change: float = tuned(0.1, "1", "change beyond which the nail is turned no further", _CURVE_LEFT)
    least_error_ratio: float = tuned(1.5, "times", "disagreement of parts from which it is undone", _CURVED)
    least_explained_share: float = tuned(
        0.4, "1", "share of the edges' residuals that the curve explains where one is evident", _CURVED
    )
    remaining_share: float = tuned(0.8, "1", "largest share of it that is left where the curve is kept", _CURVED)
    largest_error_ratio: float = tuned(3.0, "times", "disagreement that may be left where the curve is kept", _CURVED)
    as_good: float = tuned(
        1.25, "times", "disagreement, over that of the fit that is kept, of another that may be right", _AS_GOOD
    )
    most_rounds: int = tuned(3, "1", "fits, each without the curve that the one before it shows", _CURVED)
    levels: int = tuned(10, "1", "grey values between which the correction is linear", _CURVED)
    cut_share: float = tuned(0.002, "1", "share of the pixels below the first and above the last", _INSPECTION)
    pixel_sd: float = tuned(0.04, "steps", "what a pixel of an edge differs by beside the curve", _INSPECTION)
    correction_sd: float = tuned(0.1, "steps", "prior of the correction in the middle", _CURVED)
    change_sd: float = tuned(0.05, "steps", "prior of each coefficient by which it changes with the place", _CURVED)
    bend_sd: float = tuned(0.03, "steps", "prior of its second differences from level to level", _CURVED)


@dataclass(frozen=True, slots=True)
class HoleGroups:
    """Holes that one image shows (`core/hole_axes.py`)."""

    apart_deg: float = tuned(10.0, "°", "largest angle between their axes", derived("well within the limit of tilts"))
    named_apart_deg: float = tuned(
        25.0, "°", "the same of holes that the guide has too", derived("half way between them either tilt is in limits")
    )


@dataclass(frozen=True, slots=True)
class ForeignObjects:
    """What is cut off, or darker than any nail explains (`core/nail/left_out.py`, `core/nail/evidence.py`)."""

    black_window_px: int = tuned(5, "px", "side of the square in which black pixels are counted", _INSPECTION)
    largest_black_share: float = tuned(0.06, "1", "share of black pixels that is tolerated", _CUT)
    most_rounds: int = tuned(2, "1", "fits from each tilt, each without what is darker", _FOREIGN)
    blur_detector_mm: float = tuned(0.3525, "mm", "Gaussian before residuals are compared with the limit", _FOREIGN)
    limit_in_spreads: float = tuned(6.0, "robust sd", "darkness beyond which a pixel is foreign", _FOREIGN)
    least_pixels: int = tuned(12, "px", "fewest connected pixels that count", _FOREIGN)
    trimmed_rounds: int = tuned(5, "1", "fits one after another in which what is darker hardly counts", _BESIDE)
    trimmed_steps: int = tuned(4, "1", "most steps of each at full resolution", _BESIDE)
    trimmed_from_spreads: float = tuned(4.0, "robust sd", "darkness beyond which a pixel hardly counts", _BESIDE)
    trimmed_weight: float = tuned(
        1e-8, "1", "what it counts: with 0.001 the background takes up a plate", derived("next to nothing")
    )
    clear_margin: float = tuned(
        100.0, "1", "margin of a tilt over the next on the reduced image beyond which only it is tried", _BESIDE
    )
    margin_detector_mm: float = tuned(0.705, "mm", "margin around an object", derived("two blur widths"))
    around_hole_in_radii: float = tuned(
        1.5, "hole radii", "surroundings of a hole that are fitted alone", derived("inside the nail's edges")
    )
    stretch_mm: float = tuned(0.5, "mm", "along the nail: what lies beyond an object as seen from there", _FOREIGN)
    evident_darkness: float = tuned(0.35, "steps", "darkness of an evident object, from metal to background", _EVIDENT)
    directions: int = tuned(36, "1", "directions in which a rim is looked for", derived("10° each"))
    about_rim_in_radii: float = tuned(0.25, "hole radii", "distance from the rim at which pixels show it", _FOREIGN)
    seen_share: float = tuned(0.5, "1", "share of the usual pixels with which a direction is seen", _FOREIGN)


# The nail's fit: bent nails


@dataclass(frozen=True, slots=True)
class BentNail:
    """Nails that the canal bends (`core/nail/rays.py`, `core/nail/bent_nail.py`)."""

    section_step_mm: float = tuned(0.5, "mm", "between cross-sections", derived("0.1 um off an arc of 300 mm"))
    about_hole_mm: float = tuned(2.0, "mm", "beyond a hole: its own section", derived("8° of tilt and an edge's reach"))
    largest_error_ratio: float = tuned(
        1.5,
        "1",
        "errors over what the noise explains up to which a curvature is believed",
        fitted("`distalock bench bent_nails --seeds fit`: 1.2 at most; `processing --seeds fit`: from 1.9"),
    )
    chi_square: float = tuned(9.2, "1", "of both curvatures beyond what a straight nail has", standard("1 %, 2 dof"))
    doubtful_margin: float = tuned(
        5.0,
        "1",
        "margin of a straight nail over a bent one reflected, at half resolution, below which both are fitted in full",
        fitted("seeds 60000-60029 as they are: in full it is 1.4 to 4 times as large, and positive"),
    )
    near_from_deg: float = tuned(0.15, "°", "between axes: fits of one optimum end nearer together", _INSPECTION)
    near_margin: float = tuned(
        20.0,
        "1",
        "margin below which a nail bent otherwise, with axes within 1.5°, makes the axes uncertain",
        fitted("seed 65828, which judges no longer: 6 and 9 for a wrong bend over the right one"),
    )
    least_radius_mm: float = tuned(200.0, "mm", "of an optimum that counts", derived("two thirds of what canals do"))
    bound_radius_mm: float = tuned(130.0, "mm", "bound of a fit's", derived("two thirds of an optimum's that counts"))
    first_steps: int = tuned(12, "1", "steps of the fit from each start", _INSPECTION)


# The nail's fit: stages, coarse to fine


@dataclass(frozen=True, slots=True)
class NailSolver:
    """Levenberg-Marquardt (`core/nail/least_squares.py`)."""

    least_damping: float = tuned(1e-3, "1", "first and least damping", derived("below, a step hardly depends on it"))
    damping_after_failure: float = tuned(0.1, "1", "damping after a step that failed", derived("less fails again"))
    largest_damping: float = tuned(1e6, "1", "damping at which a fit ends", derived("steps are 1e-6 of the scale"))
    damping_factor: float = tuned(10.0, "1", "change of the damping", standard("Marquardt 1963"))
    coarse_tolerance: float = tuned(
        2.0, "1", "decrease of the cost that ends a coarse fit", derived("log likelihood 1")
    )
    derivative_step: float = tuned(0.005, "1", "of blur and display", derived("what curvature adds is below 1 %"))
    useless_share: float = tuned(0.3, "tolerance", "predicted decrease below which no rays are traced", _INSPECTION)
    trusted_decreases: float = tuned(5.0, "predicted decreases", "margin of gain before a fit is abandoned", _ABANDONED)
    close_deviations: float = tuned(3.0, "sd", "distance within which derivatives are kept", _KEPT)


@dataclass(frozen=True, slots=True)
class CentringStage:
    """First stage: the nail moves over its image, its tilt held, on an image so smooth that 3 mm are a small step."""

    hole_width_px: float = tuned(6.0, "stage px", "width of the smallest hole after reduction", _INSPECTION)
    smoothing_px: float = tuned(1.5, "stage px", "Gaussian after reduction", _INSPECTION)
    surroundings_mm: float = tuned(6.0, "mm", "compared surroundings of the holes", derived("twice the start's error"))
    knot_spacing_mm: float = tuned(8.0, "mm", "spacing of the background's knots", _INSPECTION)
    texture_sd: float = tuned(0.005, "1", "prior of second differences of the background", _INSPECTION)
    most_steps: int = tuned(8, "1", "steps of the fit", _INSPECTION)


@dataclass(frozen=True, slots=True)
class TiltSearchStage:
    """Second stage: distinct local optima of the pose on a reduced, smoothed image."""

    hole_width_px: float = tuned(9.0, "stage px", "width of the smallest hole after reduction", _NINE_PX)
    smoothing_px: float = tuned(0.8, "stage px", "Gaussian after reduction", _SMOOTHED_SEARCH)
    surroundings_mm: float = tuned(3.5, "mm", "compared surroundings of the holes", _ON_INDEPENDENT)
    knot_spacing_mm: float = tuned(4.0, "mm", "spacing of the background's knots", _INSPECTION)
    texture_sd: float = tuned(0.02, "1", "prior of second differences of the background", _INSPECTION)
    least_reduction: int = tuned(2, "image px", "least side of a pixel", derived("at 1 near optima do not merge"))
    further_tilt_deg: float = tuned(6.0, "°", "pitch and roll of the four further starts", _SMOOTHED_SEARCH)
    distinct_deg: float = tuned(1.5, "°", "angle of a hole's axis from which two optima differ", _INSPECTION)
    screening_steps: int = tuned(4, "1", "steps before equal searches are merged", _INSPECTION)
    most_steps: int = tuned(10, "1", "steps of a search", _INSPECTION)


@dataclass(frozen=True, slots=True)
class ComparisonStage:
    """Third stage: the two best optima with all parameters free, at half resolution."""

    reduction: int = tuned(2, "image px", "side of a pixel of the stage", _INSPECTION)
    smoothing_px: float = tuned(0.8, "stage px", "Gaussian after reduction", _SMOOTHED_SEARCH)
    surroundings_mm: float = tuned(3.5, "mm", "compared surroundings of the holes", _ON_INDEPENDENT)
    knot_spacing_mm: float = tuned(2.0, "mm", "spacing of the background's knots", _INSPECTION)
    texture_sd: float = tuned(0.01, "1", "prior of second differences of the background", _INSPECTION)
    noise_steps: int = tuned(3, "1", "steps before the noise is estimated", _INSPECTION)
    most_steps: int = tuned(8, "1", "steps of a fit", _INSPECTION)
    tolerance: float = tuned(0.2, "1", "decrease of the cost that ends a fit", derived("a log likelihood of 0.1"))
    abandoned_margin: float = tuned(60.0, "1", "margin that ends another fit", derived("1.5 times a limit of 40"))
    nearby_tilt_deg: float = tuned(3.0, "°", "tilts that test the best optimum", derived("twice `distinct_deg`"))
    nearby_steps: int = tuned(3, "1", "steps of these tests", _INSPECTION)
    most_restarts: int = tuned(3, "1", "searches resumed from a better tilt nearby", _INSPECTION)


@dataclass(frozen=True, slots=True)
class FinalStage:
    """Last stage: full resolution, whitened noise."""

    smoothing_px: float = tuned(0.0, "stage px", "Gaussian after reduction", derived("no detail is lost"))
    surroundings_mm: float = tuned(3.5, "mm", "compared surroundings of the holes", _ON_INDEPENDENT)
    knot_spacing_mm: float = tuned(1.5, "mm", "spacing of the background's knots", _ON_INDEPENDENT)
    texture_sd: float = tuned(0.015, "1", "prior of second differences of the background", _ON_INDEPENDENT)
    first_steps: int = tuned(5, "1", "steps before pixels are weighted anew", _INSPECTION)
    last_steps: int = tuned(4, "1", "steps after", _INSPECTION)
    tolerance: float = tuned(0.1, "1", "decrease of the cost that ends the fit", derived("a log likelihood of 0.05"))
    usual_display_bend: float = tuned(0.12, "1", "bulge or S of the display beyond which they are free", _PROCESSED)
    evident_decrease: float = tuned(9.2, "1", "decrease of the cost that frees them", derived("chi-square(2) at 1 %"))


@dataclass(frozen=True, slots=True)
class NailEvidence:
    """What is measured of a fit for its acceptance (`core/nail/evidence.py`)."""

    open_transmission: float = tuned(0.5, "1", "transmission from which a pixel is open", derived("half way"))
    near_hole_in_radii: float = tuned(1.5, "hole radii", "where a hole's open pixels are counted", _INSPECTION)
    inside_nail_in_radii: float = tuned(0.8, "nail radii", "distance from the axis: counted", _INSPECTION)
    clipped_deviations: float = tuned(6.0, "sd", "residuals beyond it count as so much", _INSPECTION)
    structure_blur_px: float = tuned(2.0, "stage px", "Gaussian before the residual's structure", _INSPECTION)
    rim_from: float = tuned(0.03, "1", "visible fraction from which a pixel is on a rim", _INSPECTION)
    rim_to: float = tuned(0.97, "1", "visible fraction up to which a pixel is on a rim", _INSPECTION)
    spot_blur_px: float = tuned(1.0, "stage px", "Gaussian before the largest residual", _INSPECTION)
    about_hole_mm: float = tuned(1.0, "mm", "margin around holes in which it is sought", _INSPECTION)
    certain_deviations: float = tuned(8.0, "sd", "residual that is no noise", _INSPECTION)
    least_step: float = tuned(0.3, "median steps", "floor of the step by which residuals are divided", _INSPECTION)


# Estimation of poses, the drill guide, several images, the head, wires

_TIME: Final = fitted(f"{_SCENES}: time against guides found")
_TOUCHING: Final = fitted(f"{_SCENES}: touching balls look larger, their errors are heavy-tailed")
_SHRUNK: Final = fitted(f"{_SCENES}: the display shrinks discs")
_HALF_COVERED: Final = fitted(f"{_SCENES}, half of the guide covered: likely pairs are of two guide balls often enough")
_BETWEEN: Final = derived("a guide between focal spot and ring, about 1 m from source to detector")
_ROWS_BESIDE_EDGES: Final = fitted(
    "a hundred seeded scenes (docs/decisions/0014); 0.02 suffices for single balls, not for rows beside an edge"
)
_LAGGING: Final = fitted("`distalock bench processing --kind lag --seeds fit --count 24` (decision 0018)")
_DISTORTION: Final = fitted(
    "a hundred seeded scenes (docs/decisions/0014): the calibration's own posterior has 50 to 240 px, median 90"
)
_NARROWLY: Final = fitted(
    "120 seeded scenes: measuring widely first moved the pose by 0.05 of its uncertainty (median), 0.6 at most"
)
_MODEL_ERRORS_FIT: Final = fitted(
    "errors of seeded scenes and of the 28 independent images, by inspection; `distalock bench model_errors` "
    "estimates it on scenes of no evaluation"
)
_TWO_IMAGES: Final = fitted(
    "by inspection: without it 3 um between two images turn the joint nail by 0.02 deg (docs/decisions/0011)"
)
_SET_UPS: Final = fitted("64 set-ups of `distalock bench fusion`: 0.44 to 0.76; at 5-11 degrees none but about z")
_HEAD_TOLERANCE: Final = physical("assumed tolerance of heads (docs/decisions/0010)")
_MISREAD: Final = physical("assumed misreading of the scale (docs/decisions/0010)")
_HEAD_CHECK: Final = fitted("`distalock bench robot_head_check`")
_WIRE_SCENES: Final = (
    "by inspection on seeded scenes with wires of `distalock bench verification` (seeds from 8000) and of "
    "`tests/accuracy/test_wires_accuracy.py`; docs/decisions/0013-wires.md"
)
_WIRES: Final = fitted(_WIRE_SCENES)
_BOTH_EDGES: Final = fitted(f"{_WIRE_SCENES}; the display's curve moves both edges alike")
_ONE_EDGE: Final = fitted(f"{_WIRE_SCENES}; what lies beside an edge moves it")
_AT_THE_NAIL: Final = derived("about where the guide's holes meet the nail")
_FRAMES: Final = "by inspection on films of `benchmarks.scenes.fluoroscopy_films`; docs/decisions/0012-guidance.md"
_FILMS: Final = fitted(_FRAMES)
_FRAME_TIME: Final = fitted(f"{_FRAMES}: time of a frame")
_HELD_TO: Final = derived("largest normalised error allowed in single images: the error stays in all later frames")
_FOUR_SIGMA: Final = standard("4 sigma")
_NO_BODY: Final = fitted("by inspection; no guide of the catalogue lacks a body")
_USUAL_FOCUS: Final = derived("1000 mm from focal spot to detector in pixels of 0.235 mm")
_UNRECORDED: Final = fitted("by inspection; no run that compared alternatives is recorded")
_BY_TILT: Final = fitted("`distalock bench accuracy --count 1000 --seed 20000`: a line through the medians by tilt")
_DRAWN: Final = fitted("by inspection of drawn images; nothing is measured by it")
_ONE_LEVEL: Final = derived("one level of an 8-bit display")
_OVER_RADIUS: Final = derived("more than a wire's radius: one of 2 mm that borders on white is hidden whole")
_ONE_BLUR: Final = derived("about one standard deviation of the smoothing")
_SECTIONS: Final = fitted(
    "dev10 and dev11: with coarser sampling the log-likelihood of one place varied by 2 to 3; "
    "docs/decisions/0013-wires.md"
)
_TEMPER: Final = fitted(
    "with 0.5, predicted errors exceeded those of seeded wires and the pair dev10, dev11 was rejected (commit 8947a41)"
)

_GUIDE_REACHES_MM: Final = (2.35, 1.41, 0.94, 0.5875, 0.3525)
_WIRE_REACHES_MM: Final = (1.41, 1.41, 1.175, 0.94, 0.705, 0.705, 0.5875, 0.5875, 0.5875, 0.5875)
_NAIL_REACHES_MM: Final = (3.29, 1.88, 1.175, 0.94, 0.705)


@dataclass(frozen=True, slots=True)
class RobustPointFit:
    """Pose from image points."""

    scale_sigmas: float = tuned(1.5, "sd", "error of a ball's centre that halves its weight (Cauchy)", _TOUCHING)


@dataclass(frozen=True, slots=True)
class ModelErrors:
    """Standard deviations of the nail model's own errors, which no image averages out."""

    tilt_deg: float = tuned(0.04, "deg", "tilt about the nail's x and y axes", _MODEL_ERRORS_FIT)
    turn_about_z_deg: float = tuned(0.02, "deg", "turn about the nail's z axis", _MODEL_ERRORS_FIT)
    position_mm: float = tuned(0.007, "mm", "across the beam, and of the length that sets the depth", _MODEL_ERRORS_FIT)
    radius_deviations: float = tuned(0.2, "sd of the prior", "estimated radii of holes and nail (6 um)", _TWO_IMAGES)
    curvature_per_m: float = tuned(0.04, "1/m", "estimated curvature, each plane", derived("tilt_deg at 15 mm"))


@dataclass(frozen=True, slots=True)
class SharedErrors:
    """What the errors of several images of one set-up have in common."""

    from_one_direction: float = tuned(0.7, "1", "correlation of errors of two images from one direction", _SET_UPS)
    within_deg: float = tuned(3.0, "deg", "angle (standard deviation) over which it falls", _SET_UPS)
    of_the_model: float = tuned(0.5, "1", "correlation of the model's errors in two images", _SET_UPS)


@dataclass(frozen=True, slots=True)
class GuideCandidates:
    """Which discs may be balls of the guide."""

    least_radius: float = tuned(0.55, "1", "least radius over a ball's at the greatest depth", _SHRUNK)
    greatest_radius: float = tuned(1.5, "1", "greatest radius over a ball's at the least depth", _TOUCHING)
    least_depth_mm: float = tuned(450.0, "mm", "least distance of a ball from the focal spot", _BETWEEN)
    greatest_depth_mm: float = tuned(900.0, "mm", "greatest distance of a ball from the focal spot", _BETWEEN)
    most_discs: int = tuned(70, "1", "sharpest discs that are tried", _TIME)


@dataclass(frozen=True, slots=True)
class GuideSearch:
    """Search for the guide over directions, rotations and depths."""

    least_depth_mm: float = tuned(420.0, "mm", "nearest origin of the guide to the focal spot", _BETWEEN)
    greatest_depth_mm: float = tuned(920.0, "mm", "farthest origin of the guide from the focal spot", _BETWEEN)
    usual_tilt_deg: float = tuned(16.0, "deg", "largest tilt of usual views", _INSPECTION)
    usual_grid_deg: float = tuned(3.0, "deg", "spacing of directions of usual views", _INSPECTION)
    usual_pairs: int = tuned(60, "1", "pairs of discs tried there", _TIME)
    steep_from_deg: float = tuned(18.0, "deg", "least tilt of steep views", derived("usual range and half a grid step"))
    steep_to_deg: float = tuned(46.0, "deg", "largest tilt of steep views: guidance starts there", _INSPECTION)
    steep_grid_deg: float = tuned(4.0, "deg", "spacing of directions of steep views", _INSPECTION)
    steep_pairs: int = tuned(30, "1", "pairs of discs tried there", _TIME)
    shortest_pair: float = tuned(0.3, "1", "shortest pair of balls over the guide's extent", _INSPECTION)
    shortest_disc_pair: float = tuned(1.5, "1", "shortest pair of discs over that pair, seen farthest away", _TIME)
    probes: int = tuned(7, "1", "balls tested in each round; too few hits after two or three end it", _TIME)
    refined_per_pair: int = tuned(4, "1", "poses refined for each pair of discs", _TIME)
    candidates_per_pair: int = tuned(40, "1", "best scores considered for each pair of discs", _TIME)
    least_score: int = tuned(6, "1", "balls on discs for which a pose is refined", _INSPECTION)
    good_share: float = tuned(0.4, "1", "share of balls that makes an identity good", derived("share to be measured"))
    clear_share: float = tuned(0.6, "1", "share of balls at which the search ends at once", _INSPECTION)
    pairs_without_gain: int = tuned(12, "1", "further pairs after which a good identity is kept", _HALF_COVERED)
    alternative_pairs: int = tuned(8, "1", "pairs of the best identity's discs that may refute it", _INSPECTION)
    alternative_share: float = tuned(0.5, "1", "share of the best score that refines an alternative", _INSPECTION)
    same_start_deg: float = tuned(8.0, "deg", "angle below which two starts are one", derived("some grid steps"))
    same_start_mm: float = tuned(15.0, "mm", "distance across the beam below which they are", _INSPECTION)
    same_pose_deg: float = tuned(2.0, "deg", "angle below which two refined poses are one", _INSPECTION)
    same_pose_mm: float = tuned(3.0, "mm", "distance across the beam below which they are", _INSPECTION)


@dataclass(frozen=True, slots=True)
class GuideIdentification:
    """Assignment of discs to balls and its refinement."""

    search_tolerance_detector_mm: float = tuned(1.41, "mm", "distance from ball to disc that is a hit", _INSPECTION)
    map_cell_detector_mm: float = tuned(0.47, "mm", "cell of the map of discs", derived("a third of the tolerance"))
    tolerances_detector_mm: tuple[float, ...] = tuned(_GUIDE_REACHES_MM, "mm", "tolerances of assignment", _INSPECTION)
    sd_of_tolerance: float = tuned(0.3, "1", "standard deviation of a disc over the tolerance", derived("3 sigma"))
    refinement_steps: int = tuned(5, "1", "steps of the fit at each tolerance", _TIME)


@dataclass(frozen=True, slots=True)
class GuideMeasurement:
    """The guide's balls measured where the pose predicts them."""

    outlier_sigmas: float = tuned(4.0, "sd", "beyond which a ball is left out", standard("4 sigma"))
    systematic_sd_px: float = tuned(0.06, "px", "error of a ball's centre that is no noise", _ROWS_BESIDE_EDGES)
    concentric_share: float = tuned(0.7, "1", "a ring's ball within this share of a radius merges", _INSPECTION)
    least_shrinkage: float = tuned(0.7, "1", "measured over geometric radius of a disc, at least", _INSPECTION)
    most_shrinkage: float = tuned(1.1, "1", "the same, at most", _INSPECTION)
    wide_drift_px: float = tuned(1.0, "px", "error of the prediction from few discs", _INSPECTION)
    drift_px: float = tuned(0.4, "px", "error of the prediction from many discs", _INSPECTION)
    enough_identified: int = tuned(12, "1", "discs from which a pose predicts well enough to go narrow", _NARROWLY)
    usual_focal_length_px: float = tuned(4255.0, "px", "beyond, finer pixels widen surroundings", _USUAL_FOCUS)
    most_rounds: int = tuned(4, "1", "fits with outliers left out", _INSPECTION)
    fewest_balls: int = tuned(4, "1", "balls of a fit", derived("three determine a pose, the fourth tests it"))
    calibration_rms_px: float = tuned(0.3, "px", "most in `robot calibrate-guide`: else bent or another", _UNRECORDED)
    surroundings_detector_mm: float = tuned(14.1, "mm", "radius about a ball that shows the noise", _INSPECTION)
    distortion_correlation_detector_mm: float = tuned(18.8, "mm", "correlation length of distortion", _DISTORTION)


@dataclass(frozen=True, slots=True)
class Lag:
    """Earlier frames in an image, from tails of the balls' shadows (`core/guide/lag.py`)."""

    tail_detector_mm: float = tuned(1.05, "mm", "beyond a ball's edge that belongs to its shadow", _LAGGING)
    rim_detector_mm: float = tuned(2.0, "mm", "beyond a ball's edge that shows the background", _LAGGING)
    fewest_balls: int = tuned(8, "1", "balls without which no lag is reported", _LAGGING)
    chance_sigmas: float = tuned(2.5, "sd", "of the tails' median that are taken for chance", _LAGGING)
    entry_per_tail: float = tuned(2.5, "1", "shift of the nail against the guide over the tails' length", _LAGGING)
    turn_deg_per_px: float = tuned(0.7, "°/px", "turn of the nail by a tail of a pixel", _LAGGING)


@dataclass(frozen=True, slots=True)
class GuideAsBuilt:
    """When the guide's balls are taken to be displaced from where its file puts them."""

    largest_chi_square: float = tuned(2.5, "1", "chi-square per degree of freedom: a spread is estimated", _AS_BUILT)
    least_freedom: int = tuned(6, "1", "degrees of freedom without which none is", derived("six balls"))
    most_rounds: int = tuned(6, "1", "measurements in wider surroundings", _AS_BUILT)
    grown: float = tuned(1.05, "times", "growth of the surroundings without which none follows", _AS_BUILT)
    beside_mm: float = tuned(1.0, "mm", "reach of discs beside balls", derived("three times the largest spread"))
    certain_deviations: float = tuned(5.0, "sd", "of a disc that is beside its ball for certain", _AS_BUILT)
    explained_by_planes: float = tuned(0.5, "1", "share of chi-square for which planes are named", _INSPECTION)
    other_ring: float = tuned(0.2, "1", "prior probability that the ring's plates are not apart as filed", _OTHER_RING)
    other_ring_sd: float = tuned(0.03, "1", "of the focal length that they then give, relative", _OTHER_RING)


@dataclass(frozen=True, slots=True)
class NailAsBuilt:
    """What holes beside their file's places do beside the pose that is fitted to the holes as they are."""

    own_share: float = tuned(0.5, "1", "share of variance left to each hole", derived("the pose takes the mean of two"))
    usual_place_sd_mm: float = tuned(
        0.5, "mm", "of a hole beside its place", derived("where no edge of the nail shows")
    )
    usual_turn_sd_deg: float = tuned(
        10.0, "°", "of a hole beside its direction", derived("where no pixel shows a hole")
    )
    second_bore_directions: int = tuned(
        4, "1", "directions in which holes may be bored twice", derived("nearest within 22.5°, its cosine 0.92")
    )
    much_turned_deg: float = tuned(
        0.3, "°", "turn by second bores from where a refusal names it", derived("0.6° of 1.5")
    )
    much_displaced_mm: float = tuned(0.03, "mm", "spread from where a refusal names it", derived("0.1 mm of an entry"))


@dataclass(frozen=True, slots=True)
class HoleChannels:
    """Channels along the beam in what fills the holes (`core/nail/hole_content.py`)."""

    widths: tuple[float, ...] = tuned(
        (0.7, 0.76, 0.82, 0.88), "hole widths", "widths that are tried", derived("of 5 mm: radii in steps of 0.15 mm")
    )
    by_noise: float = tuned(
        8.0,
        "1",
        "fall of chi-square that is not theirs",
        fitted("plain scenes 60600-60613: 0.5 to 5.6, one 8.5; with channels from 22"),
    )
    turn: float = tuned(
        3.0,
        "times",
        "turn by a channel over that of one step",
        fitted("seeds 64309-64319, independent dev03, dev04: 1.6 to 4.2"),
    )
    usual_sd: float = tuned(0.3, "1", "logarithm of what one lets through more", physical("0.3 mm of steel at 60 keV"))
    much_turned_deg: float = tuned(0.3, "°", "turn from where a refusal names them", derived("0.6° of 1.5"))


@dataclass(frozen=True, slots=True)
class HoleContent:
    """The background about holes, which hold what is not beside the nail (`core/nail/hole_content.py`)."""

    reach_radii: float = tuned(2.5, "hole radii", "so far from a hole's middle it may be looser", _CONTENT)
    looser: tuple[float, ...] = tuned(
        (40.0, 10.0, 3.0, 1.0), "1", "its second differences there over the usual ones, to choose from", _CONTENT
    )


@dataclass(frozen=True, slots=True)
class HeadErrors:
    """Errors of head, mount and C-arm that are usual, and what shows a wrong head (docs/decisions/0010)."""

    head_sd_mm: float = tuned(1.0, "mm", "place of the head on its file, per axis", _HEAD_TOLERANCE)
    head_sd_deg: float = tuned(1.0, "deg", "rotation of the head on its file, per axis", _HEAD_TOLERANCE)
    wrong_extension_sd_mm: float = tuned(10.0, "mm", "an extension that was read wrong", _MISREAD)
    yield_share: float = tuned(0.03, "1", "share of the travel that the mount yields to soft tissue", _HEAD_CHECK)
    yield_deg_per_mm: float = tuned(0.05, "deg/mm", "turn of the base for each mm of travel", _HEAD_CHECK)
    nudge_sd_deg: float = tuned(0.05, "deg", "turn of a C-arm that seems to stand still", _HEAD_CHECK)
    beyond_range_sigmas: float = tuned(2.0, "sd", "of an extension beyond what the head has", standard("95 %"))


@dataclass(frozen=True, slots=True)
class WirePrior:
    """Prior of a wire through a hole of the guide, before any image is evaluated."""

    protrusion_mm: float = tuned(40.0, "mm", "expected length of wire on the surgeon's side of the guide", _WIRES)
    protrusion_sd_mm: float = tuned(25.0, "mm", "standard deviation of that length", _WIRES)
    least_play_sd_mm: float = tuned(0.05, "mm", "least deviation in the bore", derived("wire may fill the bore"))
    bore_half_length_mm: float = tuned(10.0, "mm", "half length of a bore whose guide has no body", _NO_BODY)
    stopped_tip_sd_mm: float = tuned(6.0, "mm", "deviation of a stopped wire's tip from the near surface", _WIRES)
    passed_tip_mm: float = tuned(30.0, "mm", "tip of a passed wire beyond that surface", derived("before far cortex"))
    passed_tip_sd_mm: float = tuned(10.0, "mm", "standard deviation of that tip", _WIRES)
    bending_mm: float = tuned(0.3, "mm", "interference that a wire bends by to pass the nail", _WIRES)


@dataclass(frozen=True, slots=True)
class WireVisibility:
    """Which pixels of an image can show a wire."""

    blur_detector_mm: float = tuned(0.282, "mm", "standard deviation of the smoothing before derivatives", _WIRES)
    border_detector_mm: float = tuned(1.41, "mm", "margin of border and aperture", derived("five smoothing sd"))
    margin_detector_mm: float = tuned(0.47, "mm", "margin around the nail and the balls", _WIRES)
    metal_grid_detector_mm: float = tuned(0.47, "mm", "spacing of rays in it", derived("margin around the nail"))
    least_metal_mm: float = tuned(0.4, "mm", "path through the nail beyond which it hides a wire", _WIRES)
    metal_grey_percentile: float = tuned(20.0, "%", "percentile of the nail's pixels taken as metal's grey", _WIRES)
    saturated_range: float = tuned(0.004, "1", "distance from white, over the range, that is saturated", _ONE_LEVEL)
    saturated_fraction: float = tuned(0.25, "1", "saturated share of a neighbourhood that hides a wire", _WIRES)
    saturated_neighbourhood_detector_mm: float = tuned(1.645, "mm", "width of that neighbourhood", _WIRES)
    beside_saturated_mm: float = tuned(1.5, "mm", "distance from white at the guide that hides a wire", _OVER_RADIUS)


@dataclass(frozen=True, slots=True)
class WireOutline:
    """Outline of a wire in an image and its match to edges."""

    section_spacing_detector_mm: float = tuned(0.3525, "mm", "spacing of the wire's cross-sections", _SECTIONS)
    fewest_sections: int = tuned(12, "1", "least number of cross-sections of a wire seen end on", _WIRES)
    most_sections: int = tuned(500, "1", "largest number of cross-sections", derived("3/4 of a 1000 px image"))
    cap_points: int = tuned(24, "1", "outline points of a cap", derived("one a pixel of half a circumference"))
    mask_clearance_detector_mm: float = tuned(0.29375, "mm", "distance at which a mask dims no edge", _ONE_BLUR)
    least_strength: tuple[float, float] = tuned((3.5, 4.5), "1", "slope over texture: an edge, a whole one", _WIRES)
    least_darkness: tuple[float, float] = tuned((0.35, 0.45), "1", "darkness over the nail's: edge, whole", _WIRES)
    inside_radii: float = tuned(0.7, "radii", "where the grey value inside an edge is sampled", _WIRES)
    outside_radii: float = tuned(0.6, "radii", "where the grey value outside an edge is sampled", _WIRES)


@dataclass(frozen=True, slots=True)
class WireStarts:
    """Grid of axes from which the fit of a wire starts."""

    reach_mm: float = tuned(8.0, "mm", "largest offset from the guide hole's axis at the nail", _WIRES)
    step_mm: float = tuned(0.8, "mm", "spacing of the grid", derived("below twice the reach of an edge, 0.5 mm"))
    reach_detector_mm: float = tuned(0.705, "mm", "largest distance of an edge from the outline", _WIRES)
    other_tips_mm: tuple[float, float] = tuned((-10.0, 10.0), "mm", "further tips tried with the best axes", _WIRES)
    sections: int = tuned(40, "1", "cross-sections of a wire during the search", _WIRES)
    candidates: int = tuned(40, "1", "axes that are tried with further tips", _WIRES)
    starts: int = tuned(5, "1", "starts of the fit", _WIRES)
    apart_mm: float = tuned(1.0, "mm", "least distance of two starts at the nail", derived("above the grid's spacing"))
    missing_penalty: float = tuned(0.5, "1", "cost of outline without an edge, over the gain by one", _WIRES)


@dataclass(frozen=True, slots=True)
class WireFitting:
    """Robust least squares of a wire's axis on edges near its outline."""

    reaches_detector_mm: tuple[float, ...] = tuned(_WIRE_REACHES_MM, "mm", "reach of an edge, per iteration", _WIRES)
    radius_sd_detector_mm: float = tuned(0.0705, "mm", "deviation of the wire's apparent radius in an image", _WIRES)
    edge_sd_detector_mm: float = tuned(0.08225, "mm", "standard deviation of an edge point", _WIRES)
    edge_correlation_detector_mm: float = tuned(0.94, "mm", "length of outline with one independent point", _WIRES)
    robust_detector_mm: float = tuned(0.282, "mm", "scale of the Cauchy cost of an edge point", _WIRES)
    found_gain: float = tuned(2.0, "1", "log-likelihood of an edge on the outline, per correlation length", _WIRES)
    missing_gain: float = tuned(-1.3, "1", "log-likelihood of no edge, per correlation length", _WIRES)
    found_scale_detector_mm: float = tuned(0.1175, "mm", "residual that lowers it by log 2", _WIRES)
    found_within_detector_mm: float = tuned(0.235, "mm", "residual of found outline", derived("3 edge sd"))
    same_optimum_mm: float = tuned(0.15, "mm", "difference of offsets within one optimum", _WIRES)
    optimum_temper: float = tuned(0.7, "1", "on log-likelihood differences between optima: points correlate", _TEMPER)
    scan_sigmas: float = tuned(2.5, "sd", "scan along the least certain direction", _WIRES)
    scan_steps: int = tuned(21, "1", "places of that scan", derived("a quarter of a standard deviation apart"))


@dataclass(frozen=True, slots=True)
class NailOutlineMatching:
    """The nail's two edges in an image and their match."""

    proximal_of_holes_mm: float = tuned(30.0, "mm", "length of nail proximal of its holes that is used", _WIRES)
    step_mm: float = tuned(0.5, "mm", "spacing of outline points along the nail", derived("half their correlation"))
    blur_detector_mm: float = tuned(0.282, "mm", "standard deviation of the smoothing", _WIRES)
    beside_detector_mm: float = tuned(1.175, "mm", "where an edge's step is measured", derived("four smoothing sd"))
    least_step: tuple[float, float] = tuned((0.3, 0.4), "1", "step over the median one: an edge; a whole one", _WIRES)
    reaches_detector_mm: tuple[float, ...] = tuned(_NAIL_REACHES_MM, "mm", "reach of an edge, per iteration", _WIRES)
    edge_sd_detector_mm: float = tuned(0.0705, "mm", "standard deviation of an edge point", _WIRES)
    edge_correlation_detector_mm: float = tuned(1.41, "mm", "length with one independent edge point", _WIRES)
    robust_detector_mm: float = tuned(0.235, "mm", "scale of the Cauchy cost of an edge point", _WIRES)
    both_edges_sd_detector_mm: float = tuned(0.1645, "mm", "common shift of both edges outwards", _BOTH_EDGES)
    one_edge_sd_detector_mm: float = tuned(0.03525, "mm", "shift of one edge", _ONE_EDGE)


@dataclass(frozen=True, slots=True)
class NailWithWires:
    """Alternating fit of nail and wires in an image along the holes."""

    rough_margin_detector_mm: float = tuned(1.175, "mm", "margin around a rough nail that hides wires", _WIRES)
    rough_rounds: int = tuned(3, "1", "rounds of the alternation from a roughly placed nail", _WIRES)
    fitted_rounds: int = tuned(2, "1", "rounds of the alternation from a fitted nail", _WIRES)
    masked_beside_wire_mm: float = tuned(0.35, "mm", "margin around a wire that is masked in the nail's fit", _WIRES)
    masked_end_sigmas: float = tuned(2.0, "sd", "masked margin at a wire's ends", derived("95 %"))
    converged_deg: float = tuned(0.3, "°", "rotation of the nail in one round that ends the alternation", _WIRES)
    converged_mm: float = tuned(0.1, "mm", "shift of the nail across its holes that ends it", _WIRES)
    reach_from_axes_mm: float = tuned(18.0, "mm", "largest distance of its holes from the guide's axes", _WIRES)
    guide_to_nail_mm: float = tuned(100.0, "mm", "from the guide: where its tilt to the ray is taken", _AT_THE_NAIL)


@dataclass(frozen=True, slots=True)
class GuideGivenNail:
    """Identification of the guide's balls by where each hypothesis places the nail."""

    step_mm: float = tuned(1.0, "mm", "spacing of the places along the nail", _WIRES)
    inside_radii: float = tuned(0.6, "radii", "distance from the axis at which metal is expected", _WIRES)
    outside_radii: float = tuned(1.6, "radii", "distance from the axis at which no metal is expected", _WIRES)
    least_contrast: float = tuned(0.25, "1", "least difference of the two, over the image's range", _WIRES)
    dark_percentile: float = tuned(2.0, "%", "percentile of the image that is taken as dark", _WIRES)
    light_percentile: float = tuned(90.0, "%", "percentile of the image that is taken as light", _WIRES)
    fewest_places: int = tuned(20, "1", "least number of visible places", derived("10 mm of nail, both sides"))


@dataclass(frozen=True, slots=True)
class GuideTracking:
    """The guide in a frame, from its pose in the frame before (`core/guidance/measurement.py`)."""

    largest_shift_detector_mm: float = tuned(35.25, "mm", "largest shift of its image between two frames", _FILMS)
    same_shift_detector_mm: float = tuned(1.88, "mm", "distance of shifts that count as the same one", _FILMS)
    least_radius: float = tuned(0.6, "1", "smallest disc over the smallest ball's radius", _FILMS)
    greatest_radius: float = tuned(1.5, "1", "largest disc over the largest ball's radius", _FILMS)


@dataclass(frozen=True, slots=True)
class NailTracking:
    """The nail's fit in a frame, from its predicted pose (`core/guidance/measurement.py`)."""

    hole_px: float = tuned(12.0, "stage px", "width of the smallest hole after reduction", _FRAME_TIME)
    smoothing_px: float = tuned(0.8, "stage px", "Gaussian after reduction", _FILMS)
    surroundings_mm: float = tuned(3.0, "mm", "compared surroundings of the holes", _FILMS)
    knot_spacing_mm: float = tuned(3.0, "mm", "spacing of the background's knots", _FILMS)
    texture_sd: float = tuned(0.02, "1", "prior of second differences of the background", _FILMS)
    reference_steps: int = tuned(8, "1", "steps of the last fit in the reference image", _FRAME_TIME)
    first_steps: int = tuned(2, "1", "steps before the noise is estimated", _FRAME_TIME)
    last_steps: int = tuned(2, "1", "steps after it", _FRAME_TIME)
    reflected_steps: int = tuned(5, "1", "steps from the reflected tilt", _FRAME_TIME)
    first_tolerance: float = tuned(2.0, "1", "decrease of the cost that ends the first fit", _FRAME_TIME)
    last_tolerance: float = tuned(0.2, "1", "decrease of the cost that ends the last fit", _FRAME_TIME)
    unexplained_sigmas: float = tuned(4.0, "sd", "residual beyond which a pixel is not explained", _FOUR_SIGMA)


@dataclass(frozen=True, slots=True)
class FrameTracking:
    """Tracking from frame to frame (`core/guidance/tracking.py`)."""

    check_every: int = tuned(8, "frames", "interval at which the reflected tilt is fitted", _FRAME_TIME)
    most_missed: int = tuned(20, "frames", "frames without an estimate that end a track", derived("a hand passes"))
    contradiction_sigmas: float = tuned(4.0, "sd", "difference from a full localisation: a contradiction", _FOUR_SIGMA)
    reference_sd_factor: float = tuned(1.25, "1", "factor on the reference's standard deviations", _HELD_TO)
    predicted_sigmas: float = tuned(4.0, "sd", "turn of the nail against the prediction: refused", _FOUR_SIGMA)
    shared_correlation: float = tuned(0.5, "1", "assumed correlation of prediction and measurement", _FILMS)
    remembered: int = tuned(64, "frames", "estimates kept for comparison", derived("more than one localisation takes"))


@dataclass(frozen=True, slots=True)
class DisplayRotation:
    """Rotation of the display against the C-arm's axes, from two views of a still guide (`core/c_arm_advice.py`)."""

    least_turn_deg: float = tuned(2.0, "°", "least rotation of the C-arm between both views", _FILMS)
    largest_mismatch: float = tuned(0.25, "1", "share by which guide and C-arm may rotate differently", _FILMS)


@dataclass(frozen=True, slots=True)
class Alignment:
    """When the C-arm looks along the holes well enough (`core/alignment.py`)."""

    axis_error_deg: float = tuned(0.052, "°", "median error of an axis without tilt", _BY_TILT)
    axis_error_per_tilt: float = tuned(0.0053, "1", "by how much it grows with each degree of tilt", _BY_TILT)
    good_below_deg: float = tuned(
        5.0, "°", "tilt up to which a view is good", derived("error within half of the least")
    )


@dataclass(frozen=True, slots=True)
class HoleRims:
    """Points on the rims of holes, by which an error of the C-arm moves the nail (`core/guide_from_nail.py`)."""

    points: int = tuned(8, "1", "points on a rim", derived("all harmonics of a circle that a pose moves"))
    sd_px: float = tuned(0.1, "px", "their standard deviation", derived("it only sets weights, all the same"))


@dataclass(frozen=True, slots=True)
class PlanSearch:
    """Which moves bring a guide hole's axis onto the nail's (`core/plan.py`)."""

    tilt_share: float = tuned(1.5, "1", "tilt errors of moves over those predicted: mounts yield", _UNRECORDED)
    longest_shift_mm: float = tuned(8.0, "mm", "free travel along the axis", _UNRECORDED)
    shifts: int = tuned(33, "1", "travels that are tried", derived("0.5 mm apart"))
    largest_turn_deg: float = tuned(20.0, "°", "free rotation about the axis", _UNRECORDED)
    turns: int = tuned(11, "1", "rotations that are tried", derived("4° apart"))
    mm_per_deg: float = tuned(0.5, "mm/°", "travel that is as undesired as a degree", _UNRECORDED)
    least_askew_deg: float = tuned(0.5, "°", "axes less askew are parallel", physical("as makers drill them"))
    lever_mm: float = tuned(50.0, "mm", "travel that counts as a radian in the shortest motion", _UNRECORDED)


@dataclass(frozen=True, slots=True)
class MountingSiteSettings:
    """Where the mount's screws are advised (`core/mounting_site.py`)."""

    step_mm: float = tuned(1.0, "mm", "spacing of the places tried", derived("nobody drills by hand more exactly"))
    border_px: float = tuned(20.0, "px", "margin from the border of what the image shows", _DRAWN)
    towards_surgeon_mm: float = tuned(40.0, "mm", "a screw's axis beyond the nail's surface", _DRAWN)


@dataclass(frozen=True, slots=True)
class Overlay:
    """How what was found is drawn on the image (`overlay.py`, `drawing.py`)."""

    darkest_percentile: float = tuned(0.5, "%", "grey value that is drawn black", _DRAWN)
    brightest_percentile: float = tuned(99.5, "%", "grey value that is drawn white", _DRAWN)
    grey_levels: int = tuned(32, "1", "levels between them", derived("noise makes large files"))
    ball_margin_px: float = tuned(2.0, "px", "circles beyond a ball's edge", _DRAWN)
    guide_hole_mm: float = tuned(10.0, "mm", "guide's axes to either side", _DRAWN)
    axis_mm: float = tuned(40.0, "mm", "nail's axes towards the surgeon", _DRAWN)
    proximal_mm: float = tuned(60.0, "mm", "nail's outline proximal of its holes", _DRAWN)
    edge_step_mm: float = tuned(4.0, "mm", "spacing of its points", _DRAWN)
    rim_points: int = tuned(49, "1", "points of a rim", _DRAWN)
    path_points: int = tuned(9, "1", "points of a drill's path", _DRAWN)
    subpixel_bits: int = tuned(4, "bits", "fractions of a pixel", derived("a sixteenth"))


NAIL_BAND_SEARCH: Final = NailBandSearch()
NAIL_HOLE_SEARCH: Final = NailHoleSearch()
OPENING_OUTLINE: Final = OpeningOutline()
NAIL_CONTOUR: Final = NailContour()
OPENING_COVER: Final = OpeningCover()
FIT_REGION: Final = FitRegionSettings()
RAY_SAMPLING: Final = RaySampling()
BEAM: Final = BeamPhysics()
BENT_NAIL: Final = BentNail()
NAIL_PRIORS: Final = NailPriors()
NAIL_NOISE: Final = NailNoise()
NAIL_SOLVER: Final = NailSolver()
AGREEMENT_OF_PARTS: Final = AgreementOfParts()
DISPLAY_CURVE: Final = DisplayCurveFit()
HOLE_GROUPS: Final = HoleGroups()
FOREIGN_OBJECTS: Final = ForeignObjects()
CENTRING_STAGE: Final = CentringStage()
TILT_SEARCH_STAGE: Final = TiltSearchStage()
COMPARISON_STAGE: Final = ComparisonStage()
FINAL_STAGE: Final = FinalStage()
NAIL_EVIDENCE: Final = NailEvidence()
MODEL_ERRORS: Final = ModelErrors()
ROBUST_POINT_FIT: Final = RobustPointFit()
SHARED_ERRORS: Final = SharedErrors()
GUIDE_CANDIDATES: Final = GuideCandidates()
GUIDE_SEARCH: Final = GuideSearch()
GUIDE_IDENTIFICATION: Final = GuideIdentification()
GUIDE_MEASUREMENT: Final = GuideMeasurement()
LAG: Final = Lag()
GUIDE_AS_BUILT: Final = GuideAsBuilt()
NAIL_AS_BUILT: Final = NailAsBuilt()
HOLE_CHANNELS: Final = HoleChannels()
HOLE_CONTENT: Final = HoleContent()
HEAD_ERRORS: Final = HeadErrors()
WIRE_PRIOR: Final = WirePrior()
WIRE_VISIBILITY: Final = WireVisibility()
WIRE_OUTLINE: Final = WireOutline()
WIRE_STARTS: Final = WireStarts()
WIRE_FITTING: Final = WireFitting()
NAIL_OUTLINE_MATCHING: Final = NailOutlineMatching()
NAIL_WITH_WIRES: Final = NailWithWires()
GUIDE_GIVEN_NAIL: Final = GuideGivenNail()
GUIDE_TRACKING: Final = GuideTracking()
NAIL_TRACKING: Final = NailTracking()
FRAME_TRACKING: Final = FrameTracking()
DISPLAY_ROTATION: Final = DisplayRotation()
ALIGNMENT: Final = Alignment()
HOLE_RIMS: Final = HoleRims()
PLAN_SEARCH: Final = PlanSearch()
MOUNTING_SITE: Final = MountingSiteSettings()
OVERLAY: Final = Overlay()

SETTINGS: Final = declared_groups(globals())

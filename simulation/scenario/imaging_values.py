"""The C-arm of a scenario: geometry, detector, exposure and display, as frozen values."""

from dataclasses import dataclass

from shared.geometry.frames import Ring
from shared.geometry.transform import Transform
from simulation.scenario.frames import Detector


@dataclass(frozen=True, slots=True)
class CArm:
    """The C-arm's geometry, true and nominal.

    Attributes
    ----------
    source_to_detector_mm, pixel_mm
        True values; pixels as they would be without distortion.
    nominal_source_to_detector_mm, nominal_pixel_mm
        What the C-arm writes into its images: wrong by a few per cent.
    size_px
        Rows and columns.
    isocentre_mm
        Distance from the focal spot to the axes of rotation.
    roll_deg
        Rotation of the detector about the beam.
    principal_point_px
        Where the perpendicular from the focal spot meets the detector, from the middle of the image, at the start.
    sag_px_per_deg
        How far the principal point wanders per degree of orbital and angular rotation: (x, y) each.
    start_orbital_deg, start_angular_deg
        Where the C-arm stands when the scenario begins.
    detector_from_ring
        Where the ring sits in front of the detector.
    """

    source_to_detector_mm: float
    nominal_source_to_detector_mm: float
    pixel_mm: float
    nominal_pixel_mm: float
    size_px: int
    isocentre_mm: float
    roll_deg: float
    principal_point_px: tuple[float, float]
    sag_px_per_deg: tuple[tuple[float, float], tuple[float, float]]
    start_orbital_deg: float
    start_angular_deg: float
    detector_from_ring: Transform[Detector, Ring]


@dataclass(frozen=True, slots=True)
class Intensifier:
    """Distortion and input window of an image intensifier (see `render.distortion`).

    Attributes
    ----------
    input_radius_mm
        Radius of curvature of the input screen: makes the pincushion, which is no polynomial.
    swirl_rad, swirl_width
        S-shape: rotation of the rim against the centre, and how steeply it sets in (share of the radius).
    ripple_px, ripple_wavelength_px, ripple_phase_rad, ripple_direction_rad
        A slow wave on top, so that no low polynomial fits exactly.
    shift_px
        Shift of the whole image.
    aperture_radius_px
        Radius of the visible disc.
    turn_with_angle
        Radians of extra swirl per degree of the C-arm's rotation (the Earth's magnetic field).
    """

    input_radius_mm: float
    swirl_rad: float
    swirl_width: float
    ripple_px: float
    ripple_wavelength_px: float
    ripple_phase_rad: float
    ripple_direction_rad: float
    shift_px: tuple[float, float]
    aperture_radius_px: float
    turn_with_angle: float


@dataclass(frozen=True, slots=True)
class FlatPanel:
    """A detector without distortion and without a round window."""


@dataclass(frozen=True, slots=True)
class Exposure:
    """Tube, detector and noise.

    Attributes
    ----------
    photons_per_px
        Detected quanta per pixel in the open beam behind the thigh's typical thickness: sets the noise.
    focal_spot_mm
        Edge of the square focal spot.
    blur_px, tail_px, tail_share
        Detector blur: a Gaussian, and a wider one with its share.
    scatter_to_primary
        Scattered over primary radiation, averaged over the image.
    scatter_mm, glare_mm
        Standard deviations of the two halos on the detector.
    glare_share
        Share of the light that goes into the glare halo.
    vignetting
        Loss of brightness at the rim.
    electronic_noise
        Standard deviation of white noise after the detector, relative to the mean.
    """

    tube_voltage_kv: float
    filtration_mm_aluminium: float
    photons_per_px: float
    focal_spot_mm: float
    blur_px: float
    tail_px: float
    tail_share: float
    scatter_to_primary: float
    scatter_mm: float
    glare_share: float
    glare_mm: float
    vignetting: float
    electronic_noise: float


@dataclass(frozen=True, slots=True)
class Display:
    """How the C-arm turns its signal into the grey values that it shows and sends.

    Attributes
    ----------
    quarter_turns
        The image is turned by 90 degrees this often, counter-clockwise.
    mirrored
        The columns are then reversed.
    gamma
        Exponent of the display curve.
    toe, shoulder
        How much the curve flattens near black and near white, 0 to 1.
    white_percentile
        Automatic exposure: this percentile of the signal in the window is shown at `white_level`.
    white_level
        Share of full scale.
    sharpening, sharpening_px
        Gain and radius of the edge enhancement (unsharp mask).
    bits
        8 to 16.
    """

    quarter_turns: int
    mirrored: bool
    gamma: float
    toe: float
    shoulder: float
    white_percentile: float
    white_level: float
    sharpening: float
    sharpening_px: float
    bits: int

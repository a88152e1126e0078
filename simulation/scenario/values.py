"""What a scenario is made of: frozen values, millimetres and degrees."""

from dataclasses import dataclass
from enum import StrEnum

from shared.geometry.frames import Bone, Nail, Ring, RobotBase, Room
from shared.geometry.hexapod import HexapodPart
from shared.geometry.parts import GuidePart, NailPart, RingPart
from shared.geometry.transform import Transform
from simulation.frames import Detector


class Side(StrEnum):
    """The patient's side that is operated on."""

    LEFT = "left"
    RIGHT = "right"


class MountKind(StrEnum):
    """What the robot's base is fixed to."""

    BONE = "bone"
    NAIL_HEAD = "nail_head"


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The manufactured things in the room, as their files describe them."""

    ring: RingPart
    guide: GuidePart
    nail: NailPart
    hexapod: HexapodPart


@dataclass(frozen=True, slots=True)
class PartSource:
    """Where a part comes from: its name in the product's catalogue, or a file with its content."""

    name: str
    in_catalogue: bool
    content: bytes


@dataclass(frozen=True, slots=True)
class PartSources:
    """Where the parts come from."""

    ring: PartSource
    guide: PartSource
    nail: PartSource
    hexapod: PartSource


@dataclass(frozen=True, slots=True)
class Anatomy:
    """Distal femur and thigh, in the bone's frame: +x distal along the canal, +z in the direction of drilling.

    `posterior_y` is +1 or -1: the side of y on which the condyles bulge. Half-axes are given along y (front to back)
    and z (side to side).
    """

    posterior_y: float
    shaft_half_axes_mm: tuple[float, float]
    flare_half_axes_mm: tuple[float, float]
    flare_from_to_mm: tuple[float, float]
    cortex_shaft_mm: float
    cortex_end_mm: float
    condyle_centre_x_mm: tuple[float, float]
    condyle_back_mm: tuple[float, float]
    condyle_half_axes_mm: tuple[tuple[float, float, float], tuple[float, float, float]]
    condyle_spread_mm: float
    spongy_share: float
    texture_contrast: float
    texture_seed: int
    thigh_half_axes_mm: tuple[float, float]
    thigh_centre_mm: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Placement:
    """How patient, nail and robot lie. `bone_from_base` is where the mount holds the robot's base."""

    room_from_bone: Transform[Room, Bone]
    bone_from_nail: Transform[Bone, Nail]
    bone_from_base: Transform[Bone, RobotBase]


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


@dataclass(frozen=True, slots=True)
class Drilling:
    """The drill, and how the guide yields to it.

    Attributes
    ----------
    force_n
        Range of the sideways force; each drilling has its own.
    stiffness_share
        How stiff the mount leaves the robot: 1 is as stiff as the robot's own file says.
    """

    diameter_mm: float
    force_n: tuple[float, float]
    stiffness_share: float


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """Everything that does not change during a case, from one seed."""

    seed: int
    side: Side
    mount: MountKind
    head_extension_mm: float
    parts: Parts
    sources: PartSources
    anatomy: Anatomy
    placement: Placement
    c_arm: CArm
    detector: Intensifier | FlatPanel
    exposure: Exposure
    display: Display
    drilling: Drilling

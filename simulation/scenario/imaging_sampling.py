"""Pick the C-arm, its detector, its exposure and its display."""

from dataclasses import replace

import numpy as np

from shared.geometry.frames import Ring
from shared.geometry.transform import Transform
from simulation.scenario.c_arm_angles import angles_of_beam
from simulation.scenario.files import (
    CArmRanges,
    DisplayRanges,
    ExposureRanges,
    PlacementRanges,
    Range,
    Ranges,
)
from simulation.scenario.frames import Detector
from simulation.scenario.imaging_values import CArm, Display, Exposure, FlatPanel, Intensifier
from simulation.scenario.values import Placement

_QUARTER = 90.0


def _signed(generator: np.random.Generator, ends: Range) -> float:
    """A magnitude from a range, with either sign."""
    return float(generator.uniform(*ends) * generator.choice([-1.0, 1.0]))


def sample_c_arm_body(ranges: CArmRanges, generator: np.random.Generator) -> CArm:
    """Pick the C-arm without its starting angles (zero here; see `start_angles`)."""
    g = generator
    distance, pixel = g.uniform(*ranges.source_to_detector_mm), g.uniform(*ranges.pixel_mm)
    sag = [[_signed(g, ranges.sag_mm_per_90_deg) / _QUARTER / pixel for _ in range(2)] for _ in range(2)]
    tilt = np.radians([g.uniform(*ranges.ring_tilt_deg), g.uniform(*ranges.ring_tilt_deg)])
    turn = g.uniform(-np.pi, np.pi)
    ring_offset = [g.uniform(*ranges.ring_offset_mm), g.uniform(*ranges.ring_offset_mm)]
    leaning: Transform[Detector, Ring] = Transform.from_rotvec(
        [*tilt, 0.0], [*ring_offset, -g.uniform(*ranges.ring_gap_mm)]
    )
    return CArm(
        source_to_detector_mm=distance,
        nominal_source_to_detector_mm=round(distance * (1.0 + g.uniform(*ranges.source_to_detector_error))),
        pixel_mm=pixel,
        nominal_pixel_mm=round(pixel * (1.0 + g.uniform(*ranges.pixel_error)), 3),
        size_px=ranges.size_px,
        isocentre_mm=distance - g.uniform(*ranges.nail_to_detector_mm),
        roll_deg=g.uniform(*ranges.roll_deg),
        principal_point_px=(
            g.uniform(*ranges.principal_point_offset_mm) / pixel,
            g.uniform(*ranges.principal_point_offset_mm) / pixel,
        ),
        sag_px_per_deg=((sag[0][0], sag[0][1]), (sag[1][0], sag[1][1])),
        start_orbital_deg=0.0,
        start_angular_deg=0.0,
        detector_from_ring=leaning @ Transform.from_rotvec([0.0, 0.0, turn], [0.0, 0.0, 0.0]),
    )


def start_angles(ranges: PlacementRanges, body: CArm, placement: Placement, generator: np.random.Generator) -> CArm:
    """Turn the C-arm so that its beam is tilted against the nail's holes by an angle from the range."""
    tilt, azimuth = np.radians(generator.uniform(*ranges.start_tilt_deg)), generator.uniform(-np.pi, np.pi)
    beam_nail = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    room_from_nail = placement.room_from_bone @ placement.bone_from_nail
    angles = angles_of_beam(room_from_nail.directions(beam_nail))
    return replace(body, start_orbital_deg=angles.orbital_deg, start_angular_deg=angles.angular_deg)


def sample_detector(ranges: Ranges, body: CArm, generator: np.random.Generator) -> Intensifier | FlatPanel:
    """Pick an image intensifier, or a flat panel."""
    r, g = ranges.detector, generator
    flat = g.random() < r.flat_panel_probability
    middle_px = 0.5 * (body.size_px - 1)
    rim_px = g.uniform(*r.aperture_share) * middle_px
    stretch = g.uniform(*r.pincushion)
    # arctan(x) / x = 1 - x^2 / 3: the radius of the sphere that stretches the rim by this much.
    sphere_px = rim_px / np.sqrt(3.0 * stretch)
    intensifier = Intensifier(
        input_radius_mm=float(sphere_px * body.pixel_mm),
        swirl_rad=g.uniform(*r.s_shape_mm) / (rim_px * body.pixel_mm),
        swirl_width=g.uniform(*r.s_shape_width),
        ripple_px=g.uniform(*r.ripple_px) * body.size_px / 1024,
        ripple_wavelength_px=g.uniform(*r.ripple_wavelength_px) * body.size_px / 1024,
        ripple_phase_rad=g.uniform(-np.pi, np.pi),
        ripple_direction_rad=g.uniform(-np.pi, np.pi),
        shift_px=(g.uniform(*r.shift_mm) / body.pixel_mm, g.uniform(*r.shift_mm) / body.pixel_mm),
        aperture_radius_px=float(rim_px),
        turn_with_angle=g.uniform(*r.s_shape_mm_per_90_deg) / _QUARTER / (rim_px * body.pixel_mm),
    )
    return FlatPanel() if flat else intensifier


def sample_exposure(ranges: ExposureRanges, generator: np.random.Generator) -> Exposure:
    """Pick tube, detector and noise."""
    g = generator
    return Exposure(
        tube_voltage_kv=g.uniform(*ranges.tube_voltage_kv),
        filtration_mm_aluminium=g.uniform(*ranges.filtration_mm_aluminium),
        photons_per_px=g.uniform(*ranges.photons_per_px),
        focal_spot_mm=g.uniform(*ranges.focal_spot_mm),
        blur_px=g.uniform(*ranges.blur_px),
        tail_px=g.uniform(*ranges.tail_px),
        tail_share=g.uniform(*ranges.tail_share),
        scatter_to_primary=g.uniform(*ranges.scatter_to_primary),
        scatter_mm=g.uniform(*ranges.scatter_mm),
        glare_share=g.uniform(*ranges.glare_share),
        glare_mm=g.uniform(*ranges.glare_mm),
        vignetting=g.uniform(*ranges.vignetting),
        electronic_noise=g.uniform(*ranges.electronic_noise),
    )


def sample_display(ranges: DisplayRanges, generator: np.random.Generator) -> Display:
    """Pick the display."""
    g = generator
    mirrored, bits = g.random() < ranges.mirrored_probability, g.random()
    eight, twelve = ranges.eight_bits_probability, ranges.twelve_bits_probability
    return Display(
        quarter_turns=int(g.integers(4)),
        mirrored=bool(mirrored),
        gamma=g.uniform(*ranges.gamma),
        toe=g.uniform(*ranges.toe),
        shoulder=g.uniform(*ranges.shoulder),
        white_percentile=g.uniform(*ranges.white_percentile),
        white_level=g.uniform(*ranges.white_level),
        sharpening=g.uniform(*ranges.sharpening),
        sharpening_px=g.uniform(*ranges.sharpening_px),
        bits=8 if bits < eight else 12 if bits < eight + twelve else 16,
    )

"""What the Cramér-Rao limit needs of a scene: derivatives of the expected signal, and what the noise is made of.

All in the detector's signal, relative to the open beam, before the display: what the display does can be undone, but
for its rounding and clipping, so it changes no information. Unknowns of the display are derivatives all the same.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.limits.cramer_rao_crop import SAMPLES, Crop, crop_about_holes
from benchmarks.limits.cramer_rao_display import Shown, averaged, blurred, derivatives_after_tracing
from shared.geometry.frames import Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform
from simulation.render import detector
from simulation.render.attenuation import Material, Spectrum
from simulation.render.primary import trace
from simulation.render.scene import BallsInView, balls_in_view, pack_scene
from simulation.render.tracer import trace_rows
from simulation.scenario.values import Scenario
from simulation.world.poses import World, starting_state, world_at

Floats = NDArray[np.float64]
_TEXTURES = 4
# Steps of the pose: rotation vector (rad) and translation (mm) in the nail's frame, the last along the holes' ray,
# where it only changes how large they appear. Along the nail's own z so long a step would move them across the image
# as well, farther than a derivative allows, and the error would look like information on the depth.
_POSE_STEPS = (*np.radians([0.3, 0.3, 0.3]).tolist(), 0.05, 0.05, 2.0)
_RADIUS_STEP_MM, _CHAMFER_STEP_MM, _LOG_STEP = 0.05, 0.1, 0.04
_USUAL_CHAMFER_MM = 0.4
# Standard deviations of what is known beforehand, after the pose; infinite where nothing is.
PRIORS = {
    "hole radius, mm": 0.03,
    "nail radius, mm": 0.03,
    "chamfer, mm": 0.15,
    "log attenuation": 0.5,
    "log blur": 0.35,
    "share of the wide blur": 0.15,
    "log width of the wide blur": 0.2,
    "floor": np.inf,
    "floor along columns": np.inf,
    "floor along rows": np.inf,
    "gamma": 0.3,
    "toe": 0.1,
    "shoulder": 0.1,
    "sharpening": 0.4,
    "log sharpening width": 0.4,
}


@dataclass(frozen=True, slots=True, eq=False)
class SceneImages:
    """One image about the holes, and what shaped it.

    Attributes
    ----------
    counted
        Pixels that count: near one hole and not clipped, shape (holes, rows, columns).
    derivatives
        Of the expected signal by the pose and then by the unknowns of `PRIORS`, shape (2, 6 + P, rows, columns): twice,
        with errors from the rays' samples that have nothing in common.
    prior_precision
        Shape (6 + P,).
    quanta, white
        Variance of the quanta before the blur correlates them, and of what is added after it, shape (rows, columns).
    gain
        How much a relative change of the background changes the signal, shape (rows, columns).
    texture_samples
        Relative change of the background by each of some random textures, shape (S, rows, columns).
    px_per_mm
        In the nail's plane.
    """

    counted: NDArray[np.bool_]
    derivatives: Floats
    prior_precision: Floats
    quanta: Floats
    white: Floats
    gain: Floats
    texture_samples: Floats
    px_per_mm: float
    scenario: Scenario

    def blur_transfer(self, shape: tuple[int, int]) -> Floats:
        """Transfer function of the detector's blur on the real transform of images of a shape."""
        e = self.scenario.exposure
        f2 = np.fft.fftfreq(shape[0])[:, None] ** 2 + np.fft.rfftfreq(shape[1])[None, :] ** 2
        narrow, wide = (np.exp(-2.0 * (np.pi * s) ** 2 * f2) for s in (e.blur_px, e.tail_px))
        return np.asarray((1.0 - e.glare_share) * ((1.0 - e.tail_share) * narrow + e.tail_share * wide))


def scene_images(scenario: Scenario, samples: int = SAMPLES) -> SceneImages:
    """Everything about the first image of a scene; `samples` rays, a power of two, in each set of an edge's pixel."""
    world = world_at(scenario, starting_state(scenario))
    balls = balls_in_view(scenario, world)
    packed = pack_scene(scenario, world, balls)
    primary = trace(scenario, world, packed).primary
    signal = detector.noise_free_signal(primary, scenario.detector, scenario.exposure, scenario.c_arm.pixel_mm)
    seen = detector.detected(signal, scenario.exposure, scenario.c_arm.pixel_mm)
    crop = crop_about_holes(scenario, world, packed, primary, samples)
    where = (crop.rows, crop.columns)
    loss = _loss(scenario)[where].astype(np.float64)
    traced = [
        np.stack([blurred(scenario, loss * by_one_set) for by_one_set in derivative])
        for derivative in _traced_derivatives(scenario, world, balls, crop)
    ]
    shown = Shown(scenario, seen, np.asarray(detector.window(scenario.detector, scenario.c_arm.size_px)))
    after = np.stack(list(derivatives_after_tracing(scenario, signal, seen, where, shown)))
    exposure = scenario.exposure
    rounding = (1.0 / (2**scenario.display.bits - 1)) ** 2 / 12.0 / shown.slope()[where] ** 2
    return SceneImages(
        counted=crop.holes & shown.unclipped()[where],
        derivatives=np.concatenate([np.stack(traced, axis=1), np.stack([after, after])], axis=1),
        prior_precision=np.array([0.0] * 6 + [sd**-2.0 for sd in PRIORS.values()]),
        quanta=averaged(
            scenario, signal[where].astype(np.float64) * float(np.median(signal)) / exposure.photons_per_px
        ),
        white=(exposure.electronic_noise * float(np.median(seen))) ** 2 + rounding,
        gain=averaged(scenario, loss * primary[where]),
        texture_samples=_texture_samples(scenario, world, crop),
        px_per_mm=_px_per_mm(world),
        scenario=scenario,
    )


def _px_per_mm(world: World) -> float:
    return float(world.intrinsic_matrix_px[0, 0] / world.beam_from_nail.translation_mm[2])


def _loss(scenario: Scenario) -> NDArray[np.float32]:
    """Vignetting: what the detector makes of an even signal."""
    even = np.ones((scenario.c_arm.size_px,) * 2, dtype=np.float32)
    bare = replace(scenario.exposure, scatter_to_primary=0.0)
    return detector.noise_free_signal(even, scenario.detector, bare, scenario.c_arm.pixel_mm)


def _traced_derivatives(scenario: Scenario, world: World, balls: BallsInView, crop: Crop) -> Iterator[Floats]:
    """Of the primary radiation: by the pose, the radii of holes and nail, the chamfers, the metal's attenuation.

    Each of shape (2, rows, columns), by either set of samples.
    """
    yield from _pose_derivatives(scenario, world, balls, crop)
    for k, step in enumerate((_RADIUS_STEP_MM, _RADIUS_STEP_MM, _CHAMFER_STEP_MM)):
        sides = [
            crop.primary(pack_scene(_with_nail(scenario, _changed(scenario.parts.nail, k, s * step)), world, balls))
            for s in (0.5, -0.5)
        ]
        yield (sides[0] - sides[1]) / step
    packed = pack_scene(scenario, world, balls)
    metal = Material(packed.nail_material)
    sides = [crop.primary(packed, _denser(crop.beam, metal, s * _LOG_STEP)) for s in (0.5, -0.5)]
    yield (sides[0] - sides[1]) / _LOG_STEP


def _pose_derivatives(scenario: Scenario, world: World, balls: BallsInView, crop: Crop) -> Floats:
    """By a small motion (rad, mm) of the nail in its own frame, shape (6, 2, rows, columns)."""
    motions = _pose_steps(world, scenario.parts.nail)
    changes = []
    for motion in motions:
        sides = []
        for sign in (0.5, -0.5):
            moved: Transform[Nail, Nail] = Transform.from_rotvec(sign * motion[:3], sign * motion[3:])
            elsewhere = replace(world, beam_from_nail=world.beam_from_nail @ moved)
            sides.append(crop.primary(pack_scene(scenario, elsewhere, balls)))
        changes.append(sides[0] - sides[1])
    return np.asarray(np.tensordot(np.linalg.inv(motions), np.stack(changes), axes=1))


def _pose_steps(world: World, nail: NailPart) -> Floats:
    """Motions (rad, mm) of the nail in its own frame, shape (6, 6), one a row."""
    motions = np.diag(_POSE_STEPS)
    middle = np.mean([hole.axis.point_mm for hole in nail.holes], axis=0)
    ray = world.beam_from_nail.rotation.T @ (world.beam_from_nail @ middle)
    motions[5, 3:] = _POSE_STEPS[5] * ray / np.linalg.norm(ray)
    return motions


def _changed(nail: NailPart, which: int, by_mm: float) -> NailPart:
    """A nail with larger holes (0), a larger radius (1) or deeper chamfers (2)."""
    if which == 1:
        return replace(nail, diameter_mm=nail.diameter_mm + 2.0 * by_mm)
    deeper = by_mm if which == 2 else 0.0
    wider = 2.0 * by_mm if which == 0 else 0.0
    holes = tuple(
        replace(
            hole,
            diameter_mm=hole.diameter_mm + wider,
            chamfer_mm=(_USUAL_CHAMFER_MM if hole.chamfer_mm is None else hole.chamfer_mm) + deeper,
        )
        for hole in nail.holes
    )
    return replace(nail, holes=holes)


def _with_nail(scenario: Scenario, nail: NailPart) -> Scenario:
    return replace(scenario, parts=replace(scenario.parts, nail=nail))


def _denser(beam: Spectrum, metal: Material, by: float) -> Spectrum:
    attenuation = beam.attenuation_per_mm.copy()
    attenuation[metal] *= np.exp(by)
    return replace(beam, attenuation_per_mm=attenuation)


def _texture_samples(scenario: Scenario, world: World, crop: Crop) -> Floats:
    """Relative signal behind the same bone with several random textures, without metal, shape (S, rows, columns)."""
    bare = replace(world, state=replace(world.state, nail_present=False, guide_present=False))
    logs = []
    for k in range(_TEXTURES):
        other = replace(scenario, anatomy=replace(scenario.anatomy, texture_seed=k + 1))
        packed = pack_scene(other, bare, _no_balls())
        signal, _ = trace_rows(packed, 0, crop.targets_mm, crop.beam.weight, crop.beam.attenuation_per_mm)
        logs.append(np.log(np.maximum(signal.astype(np.float64), 1e-12)))
    samples = np.stack(logs)
    return np.asarray((samples - samples.mean(axis=0)) * np.sqrt(_TEXTURES / (_TEXTURES - 1.0)))


def _no_balls() -> BallsInView:
    none = np.zeros((0, 2))
    return BallsInView((), np.zeros((0, 3)), np.zeros(0), none, none, np.zeros(0))

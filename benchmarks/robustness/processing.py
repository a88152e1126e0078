"""Own scenes through what displays and C-arms do to the image; writes its part of docs/benchmarks/robustness.md.

usage: distalock bench processing [--kind NAME ...] [--count 20] [--seeds judged] [--rows FILE] [--images FOLDER]

Each image of a seeded scene is processed with parameters drawn from its seed, then localised.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.robustness import held_out as held_out_kinds
from benchmarks.robustness import tone
from benchmarks.robustness.command import RobustnessBench, run_bench
from benchmarks.robustness.kinds import CONTROL, Kind, first_line, held_out, rendered_kind
from benchmarks.robustness.scene import (
    Drawn,
    ImageFolder,
    RobustScene,
    generator_of,
    plain_scene,
    rendered,
    scene_of_shot,
)
from benchmarks.robustness.tone import Grey, Operator, Processed
from benchmarks.scenes.random_scenes import scene_of_seed
from services.imaging.core.nominal import NominalGeometry
from simulation.render.detector import radius_of_pixels
from simulation.render.image import ImageFaults
from simulation.scenario.c_arm_angles import CArmAngles
from simulation.world.poses import starting_state

# Weights of the newest frame and of the three before it: a recursive filter that keeps 40 % of what was shown.
_LAG_WEIGHTS = (0.6, 0.24, 0.1, 0.06)
_LAG_STEP_DEG = (0.02, 0.25)
_DEAD_SHARE = 1e-3


def dead_pixels(share: Grey, generator: np.random.Generator) -> Processed:
    """One pixel in a thousand is black or white."""
    spoiled = share.copy()
    dead = generator.random(share.shape) < _DEAD_SHARE
    spoiled[dead] = generator.integers(0, 2, int(dead.sum())).astype(np.float32)
    return Processed(spoiled, {"share": _DEAD_SHARE})


def dead_line(share: Grey, generator: np.random.Generator) -> Processed:
    """One row or column of the middle half, where the nail lies, is black or white."""
    spoiled, along = share.copy(), int(generator.integers(2))
    at = int(generator.uniform(0.25, 0.75) * share.shape[along])
    value = int(generator.integers(2))
    np.moveaxis(spoiled, along, 0)[at] = value
    return Processed(spoiled, {"along": ("row", "column")[along], "at": at, "value": value})


def vignetted(share: Grey, generator: np.random.Generator) -> Processed:
    """Brightness falls with the squared distance from the middle, by 20 to 60 % at half the width."""
    loss = float(generator.uniform(0.2, 0.6))
    relative = radius_of_pixels(share.shape[0]) / (0.5 * share.shape[0])
    return Processed((share * np.clip(1.0 - loss * relative**2, 0.05, 1.0)).astype(np.float32), {"loss": loss})


def processed_scene(operator: Operator, kind: str, seed: int, images: ImageFolder) -> RobustScene:
    """The control's image through an operator."""
    control = images.scene(CONTROL, seed, plain_scene)
    return replace(processed(operator, control, generator_of(kind, seed)), kind=kind)


def processed(operator: Operator, scene: RobustScene, generator: np.random.Generator) -> RobustScene:
    """A scene's image through an operator; the number of bits stays unless the operator ends in 8."""
    white = float(np.iinfo(scene.pixels.dtype).max)
    result = operator(scene.pixels.astype(np.float32) / np.float32(white), generator)
    grey = np.dtype(np.uint8) if result.bits == 8 else scene.pixels.dtype
    pixels = np.rint(result.share.astype(np.float64) * np.iinfo(grey).max).astype(grey)
    factor = scene.pixels.shape[0] / pixels.shape[0]
    nominal = NominalGeometry(scene.nominal.source_to_detector_mm, scene.nominal.pixel_mm * factor)
    middle = (scene.middle_px[0] / factor, scene.middle_px[1] / factor)
    return replace(scene, drawn=result.drawn, pixels=pixels, nominal=nominal, middle_px=middle)


def noisy_scene(kind: str, seed: int) -> RobustScene:
    """Two to four times the usual quantum noise."""
    factor = float(generator_of(kind, seed).uniform(2.0, 4.0))
    scenario = scene_of_seed(seed)
    shot = rendered(scenario, starting_state(scenario), faults=ImageFaults(dose_factor=factor**-2))
    return scene_of_shot(kind, scenario, shot, {"factor": factor}, shot.truth.holes)


def lagging_scene(kind: str, seed: int) -> RobustScene:
    """Four frames averaged while the C-arm turned by 0.02 to 0.25° from one to the next; the newest has the truth."""
    generator, scenario = generator_of(kind, seed), scene_of_seed(seed)
    step_deg, direction = float(generator.uniform(*_LAG_STEP_DEG)), float(generator.uniform(0.0, 2.0 * np.pi))
    state = starting_state(scenario)
    shots = []
    for k in range(len(_LAG_WEIGHTS)):
        turned = CArmAngles(
            state.angles.orbital_deg + k * step_deg * np.cos(direction),
            state.angles.angular_deg + k * step_deg * np.sin(direction),
        )
        shots.append(rendered(scenario, replace(state, angles=turned), shot_number=k))
    mean = sum(weight * shot.pixels.astype(np.float64) for weight, shot in zip(_LAG_WEIGHTS, shots, strict=True))
    newest = replace(shots[0], pixels=np.rint(mean).astype(shots[0].pixels.dtype))
    drawn: Drawn = {"step_deg": step_deg, "direction_rad": direction}
    return scene_of_shot(kind, scenario, newest, drawn, newest.truth.holes)


OPERATORS: dict[str, Operator] = {
    "black_cut_off": tone.black_cut_off,
    "white_cut_off": tone.white_cut_off,
    "local_contrast": tone.local_contrast,
    "unsharp_mask": tone.unsharp_mask,
    "multi_scale": tone.multi_scale,
    "bilateral_filter": tone.bilateral_filter,
    "non_local_means": tone.non_local_means,
    "median_filter": tone.median_filter,
    "gaussian_blur": tone.gaussian_blur,
    "jpeg": tone.jpeg,
    "monitor_chain": tone.monitor_chain,
    "gamma": tone.gamma_curve,
    "s_curve": tone.s_curve,
    "dead_pixels": dead_pixels,
    "dead_line": dead_line,
    "vignetting": vignetted,
    "half_size": tone.half_size,
    "six_bits": tone.six_bits,
}
HELD_OUT: dict[str, Operator] = {
    "range_compression": held_out_kinds.range_compression,
    "local_normalisation": held_out_kinds.local_normalisation,
    "anisotropic_diffusion": held_out_kinds.anisotropic_diffusion,
    "wavelet_shrinkage": held_out_kinds.wavelet_shrinkage,
    "window_and_jpeg": held_out_kinds.window_and_jpeg,
}


def _kind(name: str, operator: Operator) -> Kind:
    return Kind(name, first_line(operator), partial(processed_scene, operator, name))


KINDS: tuple[Kind, ...] = (
    *(_kind(name, operator) for name, operator in OPERATORS.items()),
    rendered_kind(noisy_scene, "noise"),
    rendered_kind(lagging_scene, "lag"),
    *(held_out(_kind(name, operator)) for name, operator in HELD_OUT.items()),
)
BENCH = RobustnessBench("processing", "images through what displays and C-arms do to them", KINDS)


def main(arguments: Sequence[str] = ()) -> int:
    """Run the kinds of this benchmark."""
    return run_bench(BENCH, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

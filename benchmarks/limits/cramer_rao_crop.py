"""The part of an image about the nail's holes, which can be traced by itself."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from simulation.render.attenuation import Spectrum, spectrum
from simulation.render.primary import detector_points_mm
from simulation.render.tiles import TILE_PX
from simulation.render.tracer import PackedScene, refine_pixels, trace_rows
from simulation.scenario.values import Scenario
from simulation.world.poses import World

Floats = NDArray[np.float64]
_AROUND_MM = 3.0
_BLUR_MARGIN_PX = 10
_EDGE, _EDGE_REACH = 0.05, 7
# The limit then scatters by 2 % from one pair of sets to another.
SAMPLES = 32


@dataclass(frozen=True, slots=True, eq=False)
class Crop:
    """A part of the image that can be traced by itself: its pixels' places on the detector, and which rays are traced.

    `holes`, shape (holes, rows, columns): pixels near each hole; `near`, shape (rows, columns): those and what the blur
    mixes with them; `edges`: those of them over which the signal bends. `samples`, shape (2, S, 4): an edge pixel's
    rays, as `sample_sets` draws them.
    """

    rows: slice
    columns: slice
    targets_mm: Floats
    share: NDArray[np.float32]
    holes: NDArray[np.bool_]
    near: NDArray[np.bool_]
    edges: NDArray[np.bool_]
    beam: Spectrum
    samples: Floats

    def primary(self, packed: PackedScene, beam: Spectrum | None = None) -> Floats:
        """Primary radiation near the holes by each set of samples, 0 elsewhere, shape (2, rows, columns)."""
        out = np.zeros((2, *self.near.shape))
        local, even = of_crop(packed, self.columns), self.near & ~self.edges
        out[:, even] = self._traced(local, np.argwhere(even), np.zeros((1, 4)), beam or self.beam)
        for k, samples in enumerate(self.samples):
            out[k, self.edges] = self._traced(local, np.argwhere(self.edges), samples, beam or self.beam)
        return out

    def _traced(self, packed: PackedScene, pixels: NDArray[np.int64], samples: Floats, beam: Spectrum) -> Floats:
        at = (pixels[:, 0], pixels[:, 1])
        steps = np.stack([np.gradient(self.targets_mm, axis=k)[at] for k in (1, 0)], axis=1)
        in_image = np.ascontiguousarray(pixels + np.array([self.rows.start, 0]))
        share = self.share[at].astype(np.float64)
        middles = np.ascontiguousarray(self.targets_mm[at])
        traced = refine_pixels(packed, in_image, middles, steps, samples, share, beam.weight, beam.attenuation_per_mm)
        return np.asarray(traced)


def sample_sets(focal_spot_mm: float, count: int, draw: int = 0) -> Floats:
    """Two sets of places in a pixel (px from its middle) and on the focal spot (mm), shape (2, count, 4).

    Scrambled Sobol points: a pixel's mean over them is without bias, and the error of one set tells nothing of the
    other's.
    """
    sets = [qmc.Sobol(4, rng=np.random.default_rng([draw, k])).random(count) for k in range(2)]
    return np.asarray((np.array(sets) - 0.5) * np.array([1.0, 1.0, focal_spot_mm, focal_spot_mm]))


def of_crop(packed: PackedScene, columns: slice) -> PackedScene:
    """The same scene for images that begin at a column, a multiple of the tiles' width."""
    return packed._replace(tile_start=packed.tile_start[columns.start // TILE_PX :])


def crop_about_holes(
    scenario: Scenario, world: World, packed: PackedScene, primary: NDArray[np.float32], samples: int = SAMPLES
) -> Crop:
    """The rectangle about the pixels within 5 mm of the holes, across the nail and along it."""
    size = scenario.c_arm.size_px
    rows, columns = np.mgrid[0:size, 0:size].astype(np.float64)
    targets = detector_points_mm(scenario, world, np.stack([columns, rows], axis=-1))
    holes = _near_holes(scenario, world, targets)
    places = np.argwhere(holes.any(axis=0))
    low, high = places.min(axis=0), places.max(axis=0) + 1
    first = np.maximum(low - _BLUR_MARGIN_PX, 0)
    rows_cut = slice(int(first[0]), int(min(high[0] + _BLUR_MARGIN_PX, size)))
    columns_cut = slice(int(first[1]) // TILE_PX * TILE_PX, int(min(high[1] + _BLUR_MARGIN_PX, size)))
    cut = (rows_cut, columns_cut)
    beam = spectrum(scenario.exposure.tube_voltage_kv, scenario.exposure.filtration_mm_aluminium)
    targets_mm = np.ascontiguousarray(targets[cut])
    _, share = trace_rows(
        of_crop(packed, columns_cut), rows_cut.start, targets_mm, beam.weight, beam.attenuation_per_mm
    )
    holes = holes[:, rows_cut, columns_cut]
    reach = np.ones((2 * _BLUR_MARGIN_PX - 3,) * 2, np.uint8)
    any_hole: NDArray[np.uint8] = np.asarray(holes.any(axis=0), dtype=np.uint8)
    near = np.asarray(cv2.dilate(any_hole, reach) > 0)
    sets = sample_sets(scenario.exposure.focal_spot_mm, samples)
    return Crop(rows_cut, columns_cut, targets_mm, share, holes, near, near & _edges(primary[cut]), beam, sets)


def _near_holes(scenario: Scenario, world: World, targets_mm: Floats) -> NDArray[np.bool_]:
    """Pixels whose rays meet the plane through the nail's axis near each hole, shape (holes, rows, columns)."""
    pose = world.beam_from_nail
    rays = np.concatenate([targets_mm, np.full((*targets_mm.shape[:2], 1), scenario.c_arm.source_to_detector_mm)], -1)
    normal = pose.rotation[:, 2]
    place = rays * ((pose.translation_mm @ normal) / (rays @ normal))[..., None]
    return np.stack(
        [
            np.linalg.norm(place - pose @ hole.axis.point_mm, axis=-1) < 0.5 * hole.diameter_mm + _AROUND_MM
            for hole in scenario.parts.nail.holes
        ]
    )


def _edges(primary: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels near which the signal bends, with some margin for the steps of the derivatives."""
    window = np.ones((3, 3), np.uint8)
    bend = np.abs(cv2.dilate(primary, window) + cv2.erode(primary, window) - 2.0 * primary)
    bent: NDArray[np.uint8] = np.asarray(bend > _EDGE * primary, dtype=np.uint8)
    return np.asarray(cv2.dilate(bent, np.ones((_EDGE_REACH,) * 2, np.uint8)) > 0)

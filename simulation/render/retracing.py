"""Images of one place of the C-arm, between which little moved: only rays that meet what moved are traced again.

Between two shots of a procedure the robot moves the guide; bone, nail, ring and C-arm stay. The image is the same, bit
by bit, as when all rays are traced.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from simulation.render.primary import Image, Mask, Traced, trace, trace_again
from simulation.render.tracer import DELRIN, DELRIN_VOID, NAIL, NAIL_VOID, PackedScene, meets
from simulation.scenario.values import Scenario
from simulation.world.poses import World

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# What moved is looked for on a grid, which every shape is wider than; and it changes pixels around it: by the grid, by
# the edge of an edge (2 px), and by the penumbra of the focal spot, which is less than 2 px.
_GRID_PX = 2
_MARGIN_PX = 8
# Chosen: beyond it a whole image takes hardly longer.
_MOST_SHARE = 0.7
_SAME = ("bone_from_camera", "tubes", "tube_class", "texture", "spongy")
_SAME_NUMBERS = ("nail_material", "texture_mm", "detector_distance_mm", "tiles_across", "tile_px")
_SOLID_OF = {NAIL_VOID: NAIL, DELRIN_VOID: DELRIN}


class Retracing:
    """Keeps the rays of the newest image. Threads that share one see whole images: the newest is replaced at once."""

    def __init__(self) -> None:
        self._newest: tuple[Scenario, World, Traced] | None = None

    def primary(self, scenario: Scenario, world: World, scene: PackedScene) -> Image:
        """Primary radiation at each pixel, as `simulation.render.primary.trace` finds it."""
        where = self._changed(scenario, world, scene)
        if self._newest is None or where is None:
            traced = trace(scenario, world, scene)
        else:
            traced = trace_again(scenario, self._newest[2], scene, where)
        self._newest = (scenario, world, traced)
        return traced.primary

    def _changed(self, scenario: Scenario, world: World, scene: PackedScene) -> Mask | None:
        """Pixels that may differ from the newest image; None when all may."""
        if self._newest is None or self._newest[0] is not scenario or not _same_beam(self._newest[1], world):
            return None
        before = self._newest[2]
        if not _same_place(before.scene, scene):
            return None
        gone, new = _without(before.scene, scene), _without(scene, before.scene)
        if any(_lone_voids(one) for one in (gone, new)):
            return None
        grid = np.ascontiguousarray(before.targets_mm[::_GRID_PX, ::_GRID_PX])
        met = meets(gone, grid, _GRID_PX) | meets(new, grid, _GRID_PX)
        size = scenario.c_arm.size_px
        whole = np.repeat(np.repeat(met, _GRID_PX, axis=0), _GRID_PX, axis=1)[:size, :size]
        width = 2 * _MARGIN_PX + 1
        where = cv2.dilate(whole.astype(np.uint8), np.ones((width, width), np.uint8)) > 0
        return np.asarray(where) if where.mean() < _MOST_SHARE else None


def _same_beam(before: World, now: World) -> bool:
    same = np.array_equal(before.intrinsic_matrix_px, now.intrinsic_matrix_px)
    return same and before.rotation_deg == now.rotation_deg


def _same_place(before: PackedScene, now: PackedScene) -> bool:
    """Whether C-arm, bone and what they are made of are the same."""
    arrays = all(np.array_equal(getattr(before, name), getattr(now, name)) for name in _SAME)
    return arrays and all(getattr(before, name) == getattr(now, name) for name in _SAME_NUMBERS)


def _without(scene: PackedScene, other: PackedScene) -> PackedScene:
    """What of a scene is not in another one."""
    ellipsoids = _new_rows(scene.ellipsoids, scene.ellipsoid_class, other.ellipsoids, other.ellipsoid_class)
    bars = _new_rows(scene.bars, scene.bar_class, other.bars, other.bar_class)
    blocks = _new_rows(scene.blocks, scene.block_class, other.blocks, other.block_class)
    turned = not np.array_equal(scene.delrin_axes, other.delrin_axes)
    boxes = _new_rows(scene.delrin_boxes, None, other.delrin_boxes, None) | turned
    steel = _new_rows(scene.steel_boxes, None, other.steel_boxes, None)
    if not np.array_equal(scene.steel_box_axes, other.steel_box_axes):
        steel[:] = True
    balls = scene.balls.copy()
    balls[~_new_rows(scene.balls, None, other.balls, None), 3] = 0.0  # tiles name balls by their number: all stay
    return scene._replace(
        ellipsoids=scene.ellipsoids[ellipsoids],
        ellipsoid_class=scene.ellipsoid_class[ellipsoids],
        bars=scene.bars[bars],
        bar_class=scene.bar_class[bars],
        blocks=scene.blocks[blocks],
        block_class=scene.block_class[blocks],
        delrin_boxes=scene.delrin_boxes[boxes],
        steel_boxes=scene.steel_boxes[steel],
        steel_box_axes=scene.steel_box_axes[steel],
        tubes=scene.tubes[:0],
        tube_class=scene.tube_class[:0],
        balls=balls,
    )


def _new_rows(rows: Floats, kinds: Integers | None, others: Floats, other_kinds: Integers | None) -> NDArray[np.bool_]:
    known = {_key(others, other_kinds, i) for i in range(len(others))}
    return np.array([_key(rows, kinds, i) not in known for i in range(len(rows))], dtype=np.bool_)


def _key(rows: Floats, kinds: Integers | None, i: int) -> tuple[bytes, int]:
    return rows[i].tobytes(), 0 if kinds is None else int(kinds[i])


def _lone_voids(moved: PackedScene) -> bool:
    """Whether something was taken away of a solid that stays: rays meet a void only where they meet its solid."""
    solids = {int(kind) for kind in (*moved.bar_class, *moved.ellipsoid_class)}
    if len(moved.delrin_boxes):
        solids.add(DELRIN)
    kinds = {int(kind) for kind in (*moved.bar_class, *moved.block_class)}
    return any(_SOLID_OF[kind] not in solids for kind in kinds & _SOLID_OF.keys())

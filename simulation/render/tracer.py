"""The ray tracer: path lengths of every material along the ray of each pixel, and the signal behind them.

Shapes carry a class; a ray is cut at every surface it meets, and each stretch is given to one material by the classes
it lies in (`_material`): metal displaces bone, bone displaces muscle, bores and drilled holes take away.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulation.render.femur import tube
from simulation.render.shapes import box, ellipsoid, flared_block, frustum, sphere
from simulation.render.spongy import mineral_share

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Classes of shapes. Plain integers: numba compiles them into the loop.
THIGH, BONE, MARROW, DRILLED, NAIL, NAIL_VOID, DELRIN, DELRIN_VOID, PLATE, STEEL_PART = range(10)
_CLASSES = 10
# Materials of the stretches; the first seven are `attenuation.Material`, the last is bone's spongy inside.
_AIR, _MUSCLE, _CORTEX, _DELRIN, _PMMA, _TITANIUM, _STEEL, _SPONGY = range(8)
_MOST_EVENTS = 128


class PackedScene(NamedTuple):
    """All shapes in the camera's frame, in mm, packed in rows for numba (see `shapes`)."""

    ellipsoids: Floats
    ellipsoid_class: Integers
    bars: Floats
    bar_class: Integers
    blocks: Floats
    block_class: Integers
    delrin_boxes: Floats
    delrin_axes: Floats
    steel_boxes: Floats
    steel_box_axes: Floats
    tubes: Floats
    tube_class: Integers
    bone_from_camera: Floats
    balls: Floats
    tile_start: Integers
    tile_balls: Integers
    tiles_across: int
    tile_px: int
    nail_material: int
    texture: NDArray[np.float32]
    texture_mm: float
    spongy: Floats
    detector_distance_mm: float


@njit(cache=True, error_model="numpy", inline="always")
def _material(inside: Integers, nail_material: int) -> int:
    """Material of a stretch from the number of shapes of each class it lies in."""
    if inside[STEEL_PART] > 0:
        return _STEEL
    if inside[NAIL] > 0 and inside[NAIL_VOID] == 0:
        return nail_material
    if inside[DELRIN] > 0 and inside[DELRIN_VOID] == 0:
        return _DELRIN
    if inside[PLATE] > 0:
        return _PMMA
    if inside[DRILLED] > 0 and inside[THIGH] > 0:
        return _MUSCLE
    if inside[MARROW] > 0:
        return _SPONGY
    if inside[BONE] > 0:
        return _CORTEX
    return _MUSCLE if inside[THIGH] > 0 else _AIR


@njit(cache=True, error_model="numpy", inline="always")
def _add(times: Floats, codes: Integers, n: int, near: float, far: float, shape_class: int) -> int:
    """Insert both ends of a stretch into the sorted list of events."""
    if near >= far or n + 2 > _MOST_EVENTS:
        return n
    for end in range(2):
        t = near if end == 0 else far
        i = n
        while i > 0 and times[i - 1] > t:
            times[i], codes[i] = times[i - 1], codes[i - 1]
            i -= 1
        times[i], codes[i] = t, shape_class if end == 0 else shape_class + _CLASSES
        n += 1
    return n


@njit(cache=True, error_model="numpy", inline="always")
def _ball_events(scene: PackedScene, tile: int, o: Floats, d: Floats, times: Floats, codes: Integers, n: int) -> int:
    """Collect the balls whose shadows touch a tile of the image."""
    if tile >= 0:
        for k in range(scene.tile_start[tile], scene.tile_start[tile + 1]):
            a, b = sphere(scene.balls[scene.tile_balls[k]], o, d)
            n = _add(times, codes, n, a, b, STEEL_PART)
    return n


@njit(cache=True, error_model="numpy")
def _events(scene: PackedScene, tile: int, o: Floats, d: Floats, bone: Floats, times: Floats, codes: Integers) -> int:
    """Collect where the ray enters and leaves every shape, in order.

    Solids come before what is taken from them: voids and marrow are not tried when the ray misses their solid.
    """
    n = 0
    hit_nail = hit_delrin = hit_bone = False
    for i in range(scene.ellipsoids.shape[0]):
        a, b = ellipsoid(scene.ellipsoids[i], o, d)
        hit_nail |= a < b and scene.ellipsoid_class[i] == NAIL
        n = _add(times, codes, n, a, b, scene.ellipsoid_class[i])
    for i in range(scene.tubes.shape[0]):
        if scene.tube_class[i] == MARROW and not hit_bone:
            continue
        a, b = tube(scene.tubes[i], bone[0], bone[1])
        hit_bone |= a < b
        n = _add(times, codes, n, a, b, scene.tube_class[i])
    for i in range(scene.delrin_boxes.shape[0]):
        a, b = box(scene.delrin_boxes[i], scene.delrin_axes, o, d)
        hit_delrin |= a < b
        n = _add(times, codes, n, a, b, DELRIN)
    for i in range(scene.steel_boxes.shape[0]):
        a, b = box(scene.steel_boxes[i], scene.steel_box_axes[i], o, d)
        n = _add(times, codes, n, a, b, STEEL_PART)
    for i in range(scene.bars.shape[0]):
        kind = scene.bar_class[i]
        if (kind == NAIL_VOID and not hit_nail) or (kind == DELRIN_VOID and not hit_delrin):
            continue
        a, b = frustum(scene.bars[i], o, d)
        hit_nail |= a < b and kind == NAIL
        n = _add(times, codes, n, a, b, kind)
    if hit_nail:
        for i in range(scene.blocks.shape[0]):
            a, b = flared_block(scene.blocks[i], o, d)
            n = _add(times, codes, n, a, b, scene.block_class[i])
    return _ball_events(scene, tile, o, d, times, codes, n)


@njit(cache=True, error_model="numpy")
def _lengths(
    times: Floats, codes: Integers, n: int, scale: float, nail_material: int, inside: Integers, out: Floats
) -> None:
    """Add up the stretches per material, in mm."""
    out[:] = 0.0
    inside[:] = 0
    for i in range(n - 1):
        c = codes[i]
        if c < _CLASSES:
            inside[c] += 1
        else:
            inside[c - _CLASSES] -= 1
        out[_material(inside, nail_material)] += (times[i + 1] - times[i]) * scale
    out[_AIR] = 0.0


@njit(cache=True, error_model="numpy")
def _marrow_stretch(times: Floats, codes: Integers, n: int) -> tuple[float, float]:
    """From where the ray first enters spongy bone to where it last leaves it."""
    near, far = 1e30, -1e30
    for i in range(n):
        if codes[i] == MARROW:
            near = min(near, times[i])
        elif codes[i] == MARROW + _CLASSES:
            far = max(far, times[i])
    return near, far


@njit(cache=True, error_model="numpy")
def _signal(lengths: Floats, share: float, weight: Floats, attenuation: Floats) -> float:
    """Detected signal behind path lengths, relative to the open beam."""
    cortex = lengths[_CORTEX] + share * lengths[_SPONGY]
    muscle = lengths[_MUSCLE] + (1.0 - share) * lengths[_SPONGY]
    total = 0.0
    for e in range(weight.size):
        exponent = muscle * attenuation[_MUSCLE, e] + cortex * attenuation[_CORTEX, e]
        for m in range(_DELRIN, _STEEL + 1):
            exponent += lengths[m] * attenuation[m, e]
        total += weight[e] * np.exp(-exponent)
    return total


@njit(cache=True, error_model="numpy")
def _aim(scene: PackedScene, target: Floats, source: Floats, ray: Floats, bone: Floats) -> float:
    """Write the ray from a point of the focal spot to a point of the detector, and the same in the bone's frame."""
    ray[0, 0], ray[0, 1], ray[0, 2] = source[0], source[1], 0.0
    ray[1, 0], ray[1, 1] = target[0] - source[0], target[1] - source[1]
    ray[1, 2] = scene.detector_distance_mm
    m = scene.bone_from_camera
    for i in range(3):
        bone[0, i] = m[i, 0] * ray[0, 0] + m[i, 1] * ray[0, 1] + m[i, 2] * ray[0, 2] + m[i, 3]
        bone[1, i] = m[i, 0] * ray[1, 0] + m[i, 1] * ray[1, 1] + m[i, 2] * ray[1, 2]
    return float(np.sqrt(ray[1, 0] ** 2 + ray[1, 1] ** 2 + ray[1, 2] ** 2))


@njit(cache=True, error_model="numpy", nogil=True)
def trace_lengths(scene: PackedScene, targets_mm: Floats, tile: Integers) -> Floats:
    """Path lengths, shape (N, 8), in mm, of the rays from the focal spot's middle to detector points, shape (N, 2).

    Columns are `Material`, then spongy bone; that of air is 0.
    """
    count = targets_mm.shape[0]
    out = np.zeros((count, 8))
    for i in range(count):
        times, codes = np.empty(_MOST_EVENTS), np.empty(_MOST_EVENTS, np.int64)
        ray, bone = np.empty((2, 3)), np.empty((2, 3))
        scale = _aim(scene, targets_mm[i], np.zeros(2), ray, bone)
        n = _events(scene, tile[i], ray[0], ray[1], bone, times, codes)
        _lengths(times, codes, n, scale, scene.nail_material, np.empty(_CLASSES, np.int64), out[i])
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def trace_rows(
    scene: PackedScene, first_row: int, targets_mm: Floats, weight: Floats, attenuation: Floats
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """One ray per pixel, through its middle: relative signal and the spongy bone's mineral share, (rows, columns) each.

    `targets_mm`, shape (rows, columns, 2): where each pixel lies on the detector; `first_row` is the first of them in
    the image. Holds no lock of the interpreter: several threads may trace their own rows.
    """
    rows, columns = targets_mm.shape[:2]
    signal, share = np.empty((rows, columns), np.float32), np.empty((rows, columns), np.float32)
    for row in range(rows):
        times, codes = np.empty(_MOST_EVENTS), np.empty(_MOST_EVENTS, np.int64)
        inside, lengths = np.empty(_CLASSES, np.int64), np.empty(8)
        ray, bone, centre = np.empty((2, 3)), np.empty((2, 3)), np.zeros(2)
        for column in range(columns):
            scale = _aim(scene, targets_mm[row, column], centre, ray, bone)
            tile = ((first_row + row) // scene.tile_px) * scene.tiles_across + column // scene.tile_px
            n = _events(scene, tile, ray[0], ray[1], bone, times, codes)
            _lengths(times, codes, n, scale, scene.nail_material, inside, lengths)
            near, far = _marrow_stretch(times, codes, n)
            share[row, column] = mineral_share(scene.spongy, scene.texture, scene.texture_mm, bone, near, far)
            signal[row, column] = _signal(lengths, share[row, column], weight, attenuation)
    return signal, share


@njit(cache=True, error_model="numpy", nogil=True)
def trace_pixels(
    scene: PackedScene, pixels: Integers, targets_mm: Floats, weight: Floats, attenuation: Floats
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The same as `trace_rows` of some pixels, row and column in shape (N, 2): signal and mineral share, (N,) each."""
    count = pixels.shape[0]
    signal, share = np.empty(count, np.float32), np.empty(count, np.float32)
    times, codes = np.empty(_MOST_EVENTS), np.empty(_MOST_EVENTS, np.int64)
    inside, lengths = np.empty(_CLASSES, np.int64), np.empty(8)
    ray, bone, centre = np.empty((2, 3)), np.empty((2, 3)), np.zeros(2)
    for i in range(count):
        scale = _aim(scene, targets_mm[i], centre, ray, bone)
        tile = (pixels[i, 0] // scene.tile_px) * scene.tiles_across + pixels[i, 1] // scene.tile_px
        n = _events(scene, tile, ray[0], ray[1], bone, times, codes)
        _lengths(times, codes, n, scale, scene.nail_material, inside, lengths)
        near, far = _marrow_stretch(times, codes, n)
        share[i] = mineral_share(scene.spongy, scene.texture, scene.texture_mm, bone, near, far)
        signal[i] = _signal(lengths, share[i], weight, attenuation)
    return signal, share


@njit(cache=True, error_model="numpy", nogil=True)
def meets(scene: PackedScene, targets_mm: Floats, step_px: int) -> NDArray[np.bool_]:
    """Whether the rays of every so manieth pixel meet anything, shape (rows, columns), as of the targets."""
    rows, columns = targets_mm.shape[:2]
    met = np.empty((rows, columns), np.bool_)
    times, codes = np.empty(_MOST_EVENTS), np.empty(_MOST_EVENTS, np.int64)
    ray, bone, centre = np.empty((2, 3)), np.empty((2, 3)), np.zeros(2)
    for row in range(rows):
        for column in range(columns):
            _aim(scene, targets_mm[row, column], centre, ray, bone)
            tile = (row * step_px // scene.tile_px) * scene.tiles_across + column * step_px // scene.tile_px
            met[row, column] = _events(scene, tile, ray[0], ray[1], bone, times, codes) > 0
    return met


@njit(cache=True, error_model="numpy", nogil=True)
def refine_pixels(
    scene: PackedScene,
    pixels: Integers,
    targets_mm: Floats,
    step_mm: Floats,
    samples: Floats,
    share: Floats,
    weight: Floats,
    attenuation: Floats,
) -> Floats:
    """Mean signal of pixels, shape (N,), over samples of the pixel's area and of the focal spot.

    Parameters
    ----------
    pixels
        Row and column, shape (N, 2).
    targets_mm, step_mm
        Middle of each pixel on the detector, shape (N, 2), and the steps to the next column and row, shape (N, 2, 2).
    samples
        Shape (S, 4): place in the pixel, in pixels from its middle, and on the focal spot, in mm.
    share
        Mineral share of the spongy bone, shape (N,).
    """
    out = np.zeros(pixels.shape[0])
    for i in range(pixels.shape[0]):
        times, codes = np.empty(_MOST_EVENTS), np.empty(_MOST_EVENTS, np.int64)
        inside, lengths = np.empty(_CLASSES, np.int64), np.empty(8)
        ray, bone, target = np.empty((2, 3)), np.empty((2, 3)), np.empty(2)
        tile = (pixels[i, 0] // scene.tile_px) * scene.tiles_across + pixels[i, 1] // scene.tile_px
        for s in range(samples.shape[0]):
            for k in range(2):
                target[k] = targets_mm[i, k] + samples[s, 0] * step_mm[i, 0, k] + samples[s, 1] * step_mm[i, 1, k]
            scale = _aim(scene, target, samples[s, 2:], ray, bone)
            n = _events(scene, tile, ray[0], ray[1], bone, times, codes)
            _lengths(times, codes, n, scale, scene.nail_material, inside, lengths)
            out[i] += _signal(lengths, share[i], weight, attenuation)
        out[i] /= samples.shape[0]
    return out

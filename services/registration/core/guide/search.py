"""Which discs of the image are which balls of the guide: a search over all directions, rotations and depths.

A pair of discs taken for a pair of balls fixes the rotation about the beam and the position of the guide, if only one
knew from which direction it is seen: so the directions are tried on a grid, and every hypothesis is scored by how many
of the other balls fall on discs. The search assumes nothing about the pattern but that it is rigid.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.estimation.image_points import Pose
from services.registration.core.guide.identity import DiscMap, GuideIdentity, refined_identity
from services.registration.core.tuning import GUIDE_SEARCH
from shared.compiled import compiled, compiled_inline
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Guide
from shared.geometry.transform import Transform
from shared.two_cores import mapped, on_both_halves

# Fewer directions are voted on sooner than handed to another core.
_LEAST_DIRECTIONS = 16
# More hypotheses than this never matter: acceptance compares the best two.
_MOST_IDENTITIES = 12
# Depth of the guide's origin (0: impossible), cosine and sine of its turn about the beam, and its place across it.
Placement = tuple[float, float, float, float, float]
_IMPOSSIBLE = (0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Views:
    """The balls as seen from every direction of a grid, and all ordered pairs of balls.

    Attributes: `rotation` (D, 3, 3); `turned_mm` (D, N, 3) the balls so turned; `first`, `second` (P,) ball indices of
    the pairs.
    """

    rotation: NDArray[np.float64]
    turned_mm: NDArray[np.float64]
    first: NDArray[np.int64]
    second: NDArray[np.int64]


def directions_within(cone_deg: tuple[float, float], grid_deg: float) -> NDArray[np.float64]:
    """Rotations, shape (D, 3, 3), that tilt the guide by an angle in a range, drilling along the beam or against it."""
    lowest, highest = cone_deg
    rotations = []
    for tilt in np.arange(lowest, highest + 1e-9, grid_deg):
        count = max(1, round(360.0 * np.sin(np.radians(tilt)) / grid_deg))
        for azimuth in 2.0 * np.pi * np.arange(count) / count:
            axis = np.radians(tilt) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            rotations.append(Rotation.from_rotvec(axis).as_matrix())
    along = np.array(rotations)
    turn_over = np.diag([1.0, -1.0, -1.0])
    return np.concatenate([along, along @ turn_over])


def search_guide(
    camera: PinholeCamera, balls_mm: NDArray[np.float64], ideal_px: NDArray[np.float64], pixel_mm: float
) -> list[GuideIdentity]:
    """Find the ways to name discs as balls of the guide, best first, each with a different pose.

    Steep views are tried only when the usual ones name too few discs. After a good identity a few more pairs of its own
    discs are tried, so that an alternative that shares them (the guide turned or shifted) is found too.

    The balls are in the guide's frame, shape (N, 3), the discs' undistorted centres those that are most likely balls
    first, shape (M, 2).
    """
    if len(ideal_px) < 4:
        return []
    discs, tuning = DiscMap.of(camera, ideal_px, pixel_mm), GUIDE_SEARCH
    usual = (0.0, tuning.usual_tilt_deg), tuning.usual_grid_deg, tuning.usual_pairs
    steep = (tuning.steep_from_deg, tuning.steep_to_deg), tuning.steep_grid_deg, tuning.steep_pairs
    found: list[GuideIdentity] = []
    for cone, grid_deg, pairs in (usual, steep):
        views = _views(balls_mm, directions_within(cone, grid_deg))
        found = _from_likely_pairs(camera, balls_mm, views, discs, pairs, found)
        if found and len(found[0]) >= tuning.good_share * len(balls_mm):
            return _with_alternatives(camera, balls_mm, views, discs, found)
    return found


def _from_likely_pairs(
    camera: PinholeCamera,
    balls_mm: NDArray[np.float64],
    views: _Views,
    discs: DiscMap,
    pairs: int,
    found: list[GuideIdentity],
) -> list[GuideIdentity]:
    """Identities found before and those of likely pairs of discs, until more pairs would hardly find a better one."""
    best, since = len(found[0]) if found else 0, 0
    for pair in _disc_pairs(camera, balls_mm, discs.ideal_px, pairs):
        found = _merged(
            found, _identities(camera, balls_mm, views, discs, pair, GUIDE_SEARCH.least_score, _shared_votes)
        )
        reached = len(found[0]) if found else 0
        best, since = max(best, reached), 0 if reached > best else since + 1
        good = best >= GUIDE_SEARCH.good_share * len(balls_mm) and since >= GUIDE_SEARCH.pairs_without_gain
        if good or best >= GUIDE_SEARCH.clear_share * len(balls_mm):
            break
    return found


def _with_alternatives(
    camera: PinholeCamera, balls_mm: NDArray[np.float64], views: _Views, discs: DiscMap, found: list[GuideIdentity]
) -> list[GuideIdentity]:
    """Identities found before and those in which pairs of the best one's discs are other balls."""
    own = np.sort(found[0].disc_index)
    least = max(GUIDE_SEARCH.least_score, int(np.ceil(GUIDE_SEARCH.alternative_share * len(own))))
    pairs = [
        (int(own[a]), int(own[b]))
        for a, b in _disc_pairs(camera, balls_mm, discs.ideal_px[own], GUIDE_SEARCH.alternative_pairs)
    ]
    for others in mapped(lambda pair: _identities(camera, balls_mm, views, discs, pair, least, _votes), pairs, 2):
        found = _merged(found, others)
    return found


def _views(balls_mm: NDArray[np.float64], rotation: NDArray[np.float64]) -> _Views:
    apart = np.linalg.norm(balls_mm[:, None] - balls_mm[None], axis=-1)
    first, second = np.nonzero(apart > GUIDE_SEARCH.shortest_pair * apart.max())
    turned = np.ascontiguousarray(np.einsum("dij,nj->dni", rotation, balls_mm))
    return _Views(rotation, turned, first.astype(np.int64), second.astype(np.int64))


def _disc_pairs(
    camera: PinholeCamera, balls_mm: NDArray[np.float64], ideal_px: NDArray[np.float64], count: int
) -> Iterator[tuple[int, int]]:
    """Pairs of discs far enough apart to aim well and near enough to be of one guide, likely ones first.

    The order is shuffled among discs of similar rank, always in the same way.
    """
    extent = float(np.linalg.norm(balls_mm[:, None] - balls_mm[None], axis=-1).max())
    f = camera.focal_length_px
    shortest_mm = GUIDE_SEARCH.shortest_disc_pair * GUIDE_SEARCH.shortest_pair * extent
    shortest = shortest_mm * f / GUIDE_SEARCH.greatest_depth_mm
    longest = extent * f / GUIDE_SEARCH.least_depth_mm
    first, second = np.triu_indices(len(ideal_px), k=1)
    apart = np.linalg.norm(ideal_px[first] - ideal_px[second], axis=1)
    usable = np.flatnonzero((apart > shortest) & (apart < longest))
    shuffled = np.random.default_rng(0).uniform(0.0, len(balls_mm), len(usable))
    order = usable[np.argsort(second[usable] + shuffled, kind="stable")]
    for k in order[:count]:
        yield int(first[k]), int(second[k])


def _identities(
    camera: PinholeCamera,
    balls_mm: NDArray[np.float64],
    views: _Views,
    discs: DiscMap,
    pair: tuple[int, int],
    least_score: int,
    votes: Callable[[_Views, DiscMap, NDArray[np.float64]], NDArray[np.int16]],
) -> list[GuideIdentity]:
    """The best few identities in which a pair of discs are two of the guide's balls, from so many balls on discs."""
    rays = camera.rays(discs.ideal_px[list(pair)])
    slopes = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
    scores = votes(views, discs, slopes)
    best = np.argpartition(-scores.ravel(), GUIDE_SEARCH.candidates_per_pair)[: GUIDE_SEARCH.candidates_per_pair]
    best = best[np.argsort(-scores.ravel()[best], kind="stable")]
    poses: list[Pose] = []
    for d, p in zip(*np.unravel_index(best, scores.shape), strict=True):
        if scores[d, p] < least_score or len(poses) == GUIDE_SEARCH.refined_per_pair:
            break
        pose = _posed(views, int(d), int(p), slopes)
        if not any(_same(pose, other, GUIDE_SEARCH.same_start_deg, GUIDE_SEARCH.same_start_mm) for other in poses):
            poses.append(pose)
    starts = (Transform[Camera, Guide].from_rotation_translation(*pose) for pose in poses)
    return [refined_identity(camera, balls_mm, discs, start) for start in starts]


def _votes(views: _Views, discs: DiscMap, slopes: NDArray[np.float64], part: slice = slice(None)) -> NDArray[np.int16]:
    """Balls on discs for directions and pairs of balls, when such a pair lies on two rays, shape (D, P)."""
    on_rays = slopes, (GUIDE_SEARCH.least_depth_mm, GUIDE_SEARCH.greatest_depth_mm)
    seen = discs.cell_from_slope, discs.occupied
    return vote(views.turned_mm[part], views.first, views.second, *on_rays, *seen, GUIDE_SEARCH.probes)


def _shared_votes(views: _Views, discs: DiscMap, slopes: NDArray[np.float64]) -> NDArray[np.int16]:
    """The same, from both cores: for a single pair of discs."""
    halves = on_both_halves(lambda part: _votes(views, discs, slopes, part), len(views.turned_mm), _LEAST_DIRECTIONS)
    return np.concatenate(halves)


def _posed(views: _Views, direction: int, pair: int, slopes: NDArray[np.float64]) -> Pose:
    """The pose that puts a pair of balls exactly on a pair of rays (see `vote`)."""
    a, b = views.turned_mm[direction, [views.first[pair], views.second[pair]]]
    u, v = slopes[0] - slopes[1], slopes[0] * a[2] - slopes[1] * b[2]
    length2 = float(np.sum((a - b)[:2] ** 2))
    depth = (-(u @ v) + np.sqrt((u @ v) ** 2 - (u @ u) * (v @ v - length2))) / (u @ u)
    across, along = depth * u + v, (a - b)[:2]
    angle = np.arctan2(across[1], across[0]) - np.arctan2(along[1], along[0])
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    xy = slopes[0] * (depth + a[2]) - (rotation @ a)[:2]
    return rotation @ views.rotation[direction], np.array([xy[0], xy[1], depth])


def _merged(found: list[GuideIdentity], new: list[GuideIdentity]) -> list[GuideIdentity]:
    """All identities with different poses, those with most balls first, a dozen at most."""
    merged: list[GuideIdentity] = []
    poses: list[Pose] = []
    for identity in sorted(found + new, key=len, reverse=True):
        pose = identity.camera_from_guide.rotation, identity.camera_from_guide.translation_mm
        if not any(_same(pose, other, GUIDE_SEARCH.same_pose_deg, GUIDE_SEARCH.same_pose_mm) for other in poses):
            merged.append(identity)
            poses.append(pose)
    return merged[:_MOST_IDENTITIES]


def _same(a: Pose, b: Pose, angle_deg: float, across_mm: float) -> bool:
    """Whether two poses differ by less than an angle and a distance across the beam."""
    cos_angle = 0.5 * (float(np.sum(a[0] * b[0])) - 1.0)
    apart = np.linalg.norm((a[1] - b[1])[:2])
    return bool(cos_angle > np.cos(np.radians(angle_deg)) and apart < across_mm)


@compiled_inline
def _placement(
    a: NDArray[np.float64], b: NDArray[np.float64], rays: NDArray[np.float64], depth_range_mm: tuple[float, float]
) -> Placement:
    """Where the guide is when balls a and b, turned into a direction already, lie on the rays of two discs.

    With q = (x/z, y/z) of the discs' rays and depth t of the guide's origin, the balls lie at q_a (t + z_a) and
    q_b (t + z_b) across the beam; that they are the known length apart is a quadratic equation in t.
    """
    ux, uy = rays[0, 0] - rays[1, 0], rays[0, 1] - rays[1, 1]
    vx, vy = rays[0, 0] * a[2] - rays[1, 0] * b[2], rays[0, 1] * a[2] - rays[1, 1] * b[2]
    dx, dy = a[0] - b[0], a[1] - b[1]
    length2, uu, uv = dx * dx + dy * dy, ux * ux + uy * uy, ux * vx + uy * vy
    root2 = uv * uv - uu * (vx * vx + vy * vy - length2)
    if root2 <= 0.0 or length2 < 1.0:
        return _IMPOSSIBLE
    t = (-uv + np.sqrt(root2)) / uu
    if t < depth_range_mm[0] or t > depth_range_mm[1]:
        return _IMPOSSIBLE
    ax, ay = t * ux + vx, t * uy + vy
    cos, sin = (ax * dx + ay * dy) / length2, (ay * dx - ax * dy) / length2
    tx = rays[0, 0] * (t + a[2]) - (cos * a[0] - sin * a[1])
    ty = rays[0, 1] * (t + a[2]) - (sin * a[0] + cos * a[1])
    return t, cos, sin, tx, ty


@compiled_inline
def _balls_on_discs(
    turned_mm: NDArray[np.float64],
    placement: Placement,
    cell_from_slope: NDArray[np.float64],
    occupied: NDArray[np.uint8],
    stride: int,
) -> int:
    """Number of balls, shape (N, 3), on discs; 0 when given up."""
    t, cos, sin, tx, ty = placement
    # turn, shift and map to cells are one affine step
    (c0, c1, column0), (r0, r1, row0) = cell_from_slope[0], cell_from_slope[1]
    cx, cy, ct = c0 * cos + c1 * sin, c1 * cos - c0 * sin, c0 * tx + c1 * ty
    rx, ry, rt = r0 * cos + r1 * sin, r1 * cos - r0 * sin, r0 * tx + r1 * ty
    rows, columns = np.uint64(occupied.shape[0]), np.uint64(occupied.shape[1])
    hits = 0
    # balls are visited in strides, so that the first few already reach all over the pattern
    for offset in range(stride):
        for n in range(offset, turned_mm.shape[0], stride):
            x, y = turned_mm[n, 0], turned_mm[n, 1]
            nearness = 1.0 / (t + turned_mm[n, 2])
            # without a sign, what lies before the first row or column lies far behind the last
            column = np.uint64(int((cx * x + cy * y + ct) * nearness + column0))
            row = np.uint64(int((rx * x + ry * y + rt) * nearness + row0))
            if row < rows and column < columns:
                hits += occupied[row, column]
        if hits < 2 * offset and offset < 3:
            return 0
    return hits


@compiled
def vote(
    turned_mm: NDArray[np.float64],
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    rays: NDArray[np.float64],
    depth_range_mm: tuple[float, float],
    cell_from_slope: NDArray[np.float64],
    occupied: NDArray[np.uint8],
    probes: int,
) -> NDArray[np.int16]:
    """Score every direction and every ordered pair of balls, taken for one pair of discs.

    Parameters
    ----------
    turned_mm, first, second
        As in `_Views`.
    rays
        Slopes (x/z, y/z) of the rays through both discs, shape (2, 2).
    depth_range_mm
        Where the guide's origin may lie.
    cell_from_slope, occupied
        As in `DiscMap`.
    probes
        Balls tested in each round. A hypothesis is given up that has fewer than two hits after the second round, or
        four after the third. Balls are missing at random, so the first round decides nothing.

    Returns
    -------
    NDArray
        Number of balls on discs, shape (D, P); 0 where impossible or given up.
    """
    directions, balls = turned_mm.shape[0], turned_mm.shape[1]
    score = np.zeros((directions, len(first)), dtype=np.int16)
    stride = max(1, balls // probes)
    for d in range(directions):
        turned = turned_mm[d]
        for p in range(len(first)):
            placement = _placement(turned[first[p]], turned[second[p]], rays, depth_range_mm)
            if placement[0] > 0.0:
                score[d, p] = _balls_on_discs(turned, placement, cell_from_slope, occupied, stride)
    return score

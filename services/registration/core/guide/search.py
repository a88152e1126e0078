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

from services.registration.core.guide.identity import Discs, GuideIdentity, settled
from services.registration.core.guide.vote import vote
from services.registration.core.pose import RigidPose
from shared.geometry.camera import PinholeCamera
from shared.two_cores import mapped, on_both_halves

DEPTH_RANGE_MM = (420.0, 920.0)
# Range of angles between drilling and beam, their grid, and how many pairs of discs are tried there.
_STAGES = (((0.0, 16.0), 3.0, 60), ((18.0, 46.0), 4.0, 30))
_SHORTEST_PAIR = 0.3
_PROBES = 7
# Fewer are voted on sooner than handed to another core.
_LEAST_DIRECTIONS = 16
_REFINED_PER_PAIR = 4
_LOOKED_AT = 40
_LEAST_SCORE = 6
_GOOD_SHARE = 0.4
_CLEAR_SHARE = 0.6
# A good identity that so many further pairs do not better is kept: likely pairs are of two balls of the guide often
# enough that one of them would have shown a better one.
_PAIRS_WITHOUT_GAIN = 12
_RIVAL_PAIRS = 8
# A rival matters when it explains nearly as many discs; before its pose is refined it may miss some.
_RIVAL_SHARE = 0.5


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
    camera: PinholeCamera, balls_mm: NDArray[np.float64], ideal_px: NDArray[np.float64]
) -> list[GuideIdentity]:
    """Find the ways to name discs as balls of the guide, best first, each with a different pose.

    Steep views are tried only when the usual ones name too few discs. After a good identity a few more pairs of its own
    discs are tried, so that a rival that shares them (the guide turned or shifted) has its chance.

    Parameters
    ----------
    balls_mm
        Balls in the guide's frame, shape (N, 3).
    ideal_px
        Undistorted centres of the discs, shape (M, 2), those that are most likely balls first.
    """
    if len(ideal_px) < 4:
        return []
    discs = Discs.of(camera, ideal_px)
    found: list[GuideIdentity] = []
    for cone, grid_deg, pairs in _STAGES:
        views = _views(balls_mm, directions_within(cone, grid_deg))
        found = _from_likely_pairs(camera, balls_mm, views, discs, pairs, found)
        if found and len(found[0]) >= _GOOD_SHARE * len(balls_mm):
            return _with_rivals(camera, balls_mm, views, discs, found)
    return found


def _from_likely_pairs(
    camera: PinholeCamera,
    balls_mm: NDArray[np.float64],
    views: _Views,
    discs: Discs,
    pairs: int,
    found: list[GuideIdentity],
) -> list[GuideIdentity]:
    """Identities found before and those of likely pairs of discs, until more pairs would hardly find a better one."""
    best, since = len(found[0]) if found else 0, 0
    for pair in _disc_pairs(camera, balls_mm, discs.ideal_px, pairs):
        found = _merged(found, _identities(camera, balls_mm, views, discs, pair, _LEAST_SCORE, _shared_votes))
        reached = len(found[0]) if found else 0
        best, since = max(best, reached), 0 if reached > best else since + 1
        good = best >= _GOOD_SHARE * len(balls_mm) and since >= _PAIRS_WITHOUT_GAIN
        if good or best >= _CLEAR_SHARE * len(balls_mm):
            break
    return found


def _with_rivals(
    camera: PinholeCamera, balls_mm: NDArray[np.float64], views: _Views, discs: Discs, found: list[GuideIdentity]
) -> list[GuideIdentity]:
    """Identities found before and those in which pairs of the best one's discs are other balls."""
    own = np.sort(found[0].disc_index)
    least = max(_LEAST_SCORE, int(np.ceil(_RIVAL_SHARE * len(own))))
    pairs = [(int(own[a]), int(own[b])) for a, b in _disc_pairs(camera, balls_mm, discs.ideal_px[own], _RIVAL_PAIRS)]
    for rivals in mapped(lambda pair: _identities(camera, balls_mm, views, discs, pair, least, _votes), pairs, 2):
        found = _merged(found, rivals)
    return found


def _views(balls_mm: NDArray[np.float64], rotation: NDArray[np.float64]) -> _Views:
    apart = np.linalg.norm(balls_mm[:, None] - balls_mm[None], axis=-1)
    first, second = np.nonzero(apart > _SHORTEST_PAIR * apart.max())
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
    shortest, longest = 1.5 * _SHORTEST_PAIR * extent * f / DEPTH_RANGE_MM[1], extent * f / DEPTH_RANGE_MM[0]
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
    discs: Discs,
    pair: tuple[int, int],
    least_score: int,
    votes: Callable[[_Views, Discs, NDArray[np.float64]], NDArray[np.int16]],
) -> list[GuideIdentity]:
    """The best few identities in which a pair of discs are two of the guide's balls, from so many balls on discs."""
    rays = camera.rays(discs.ideal_px[list(pair)])
    slopes = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
    scores = votes(views, discs, slopes)
    best = np.argpartition(-scores.ravel(), _LOOKED_AT)[:_LOOKED_AT]
    best = best[np.argsort(-scores.ravel()[best], kind="stable")]
    poses: list[RigidPose] = []
    for d, p in zip(*np.unravel_index(best, scores.shape), strict=True):
        if scores[d, p] < least_score or len(poses) == _REFINED_PER_PAIR:
            break
        pose = _posed(views, int(d), int(p), slopes)
        if not any(_same(pose, other, 8.0, 15.0) for other in poses):
            poses.append(pose)
    return [settled(camera, balls_mm, discs, pose) for pose in poses]


def _votes(views: _Views, discs: Discs, slopes: NDArray[np.float64], part: slice = slice(None)) -> NDArray[np.int16]:
    """Balls on discs for directions and pairs of balls, when such a pair lies on two rays, shape (D, P)."""
    turned_mm, seen = views.turned_mm[part], (discs.cell_from_slope, discs.occupied)
    return vote(turned_mm, views.first, views.second, slopes, DEPTH_RANGE_MM, *seen, _PROBES)


def _shared_votes(views: _Views, discs: Discs, slopes: NDArray[np.float64]) -> NDArray[np.int16]:
    """The same, from both cores: for a single pair of discs."""
    halves = on_both_halves(lambda part: _votes(views, discs, slopes, part), len(views.turned_mm), _LEAST_DIRECTIONS)
    return np.concatenate(halves)


def _posed(views: _Views, direction: int, pair: int, slopes: NDArray[np.float64]) -> RigidPose:
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
    return RigidPose(rotation @ views.rotation[direction], np.array([xy[0], xy[1], depth]))


def _merged(found: list[GuideIdentity], new: list[GuideIdentity]) -> list[GuideIdentity]:
    """All identities with different poses, those with most balls first, a dozen at most."""
    merged: list[GuideIdentity] = []
    for identity in sorted(found + new, key=len, reverse=True):
        if not any(_same(identity.pose, other.pose, 2.0, 3.0) for other in merged):
            merged.append(identity)
    return merged[:12]


def _same(a: RigidPose, b: RigidPose, angle_deg: float, across_mm: float) -> bool:
    """Whether two poses differ by less than an angle and a distance across the beam."""
    cos_angle = 0.5 * (float(np.sum(a.rotation * b.rotation)) - 1.0)
    apart = np.linalg.norm((a.translation_mm - b.translation_mm)[:2])
    return bool(cos_angle > np.cos(np.radians(angle_deg)) and apart < across_mm)

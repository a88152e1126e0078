"""What was found in an image as vectors, for viewers that draw it themselves: the counterpart of `overlay.py`."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.drill_clearance import QUANTILE_95, across_basis
from services.registration.core.guide.locate import GuideFit
from services.registration.core.guide.measure import shadows
from services.registration.core.hole_axes import HoleEstimate, rims_of
from services.registration.core.localise import LocalisationResult, Parts
from services.registration.core.mounting_site import MountingSite
from services.registration.core.tuning import OVERLAY
from services.registration.core.wires.nail_outline import axis_about_holes_mm, touched_normals
from shared.geometry.bend import section_frame
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import Line, unit
from shared.geometry.parts import Hole, NailPart, RingPart, hole_axis, hole_surface_points
from shared.geometry.transform import Transform
from shared.messages.base import Pixel
from shared.messages.drawing import (
    Drawing,
    DrawnBall,
    DrawnEllipse,
    DrawnHole,
    DrawnPath,
    DrawnScrew,
    ImageDrawing,
    Polyline,
)

# A hundredth of a pixel: nobody sees less, and the message stays small.
_DIGITS = 2


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """Pixels of one view.

    Attributes: `project` takes points of the camera frame to them, shape (..., 3) to (..., 2); `place` those of the
    image as received, un-mirrored, shape (..., 2).
    """

    project: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    place: Callable[[NDArray[np.float64]], NDArray[np.float64]]

    def polyline(self, camera_mm: NDArray[np.float64]) -> Polyline:
        """A line through points of the camera frame, shape (N, 3)."""
        return _polyline(self.project(camera_mm))


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """What is drawn."""

    calibration: CArmCalibration
    result: LocalisationResult
    parts: Parts  # with the nail bent as it was found
    site: MountingSite | None


def image_drawing(
    image_sha256: str,
    calibration: CArmCalibration,
    result: LocalisationResult,
    parts: Parts,
    site: MountingSite | None = None,
) -> ImageDrawing:
    """Everything that was found or advised in an image, as vectors."""
    as_found = parts if result.nail is None else parts.with_nail_as_found(result.nail)
    found = _Found(calibration, result, as_found, site)
    raw = _View(calibration.image_from_camera, lambda measured_px: measured_px)
    corrected = _View(calibration.camera.project, calibration.distortion.undistort)
    return ImageDrawing(
        image_sha256=image_sha256,
        width_px=calibration.width_px,
        height_px=calibration.height_px,
        mirrored=calibration.mirrored,
        mm_per_px_at_detector=calibration.pixel_mm,
        raw=_drawing(found, raw),
        corrected=_drawing(found, corrected),
    )


def _drawing(found: _Found, view: _View) -> Drawing:
    nail, parts = found.result.nail, found.parts
    camera_from_nail = None if nail is None else nail.camera_from_nail
    return Drawing(
        ring_balls=_ring_balls(found.calibration, parts.ring, view),
        guide_balls=() if found.result.guide is None else _guide_balls(found, found.result.guide, view),
        nail_edges_px=() if camera_from_nail is None else _nail_edges(parts.nail, camera_from_nail, view),
        holes=() if camera_from_nail is None else _holes(found, camera_from_nail, view),
        drill_paths=() if found.result.guide is None else _drill_paths(found, found.result.guide, view),
        mounting_screws=() if found.site is None else _screws(found.site, view),
    )


def _ring_balls(calibration: CArmCalibration, ring: RingPart, view: _View) -> tuple[DrawnBall, ...]:
    balls, predicted = calibration.balls, shadows(calibration, ring.balls, calibration.camera_from_ring)
    seen = {int(i): k for k, i in enumerate(balls.ring_index) if i != NOT_OF_THE_RING}
    drawn = []
    for i, name in enumerate(ring.balls.ids):
        k = seen.get(i)
        if k is None:
            drawn.append(_ball(name, view.place(predicted.centre_px[i]), float(predicted.radius_px[i]), None))
            continue
        residual_px = float(np.linalg.norm(balls.centre_px[k] - predicted.centre_px[i]))
        drawn.append(_ball(name, view.place(balls.centre_px[k]), float(balls.radius_px[k]), residual_px))
    return tuple(drawn)


def _guide_balls(found: _Found, fit: GuideFit, view: _View) -> tuple[DrawnBall, ...]:
    calibration, balls = found.calibration, found.parts.guide.balls
    at_camera_mm = fit.camera_from_guide.points(balls.position_mm)
    predicted_px = view.project(at_camera_mm)
    residual_px = np.linalg.norm(fit.ideal_px - calibration.camera.project(at_camera_mm), axis=1)
    measured_px = view.place(calibration.distortion.distort(fit.ideal_px))
    radius_px = shadows(calibration, balls, fit.camera_from_guide).radius_px
    return tuple(
        _ball(name, measured_px[i] if used else predicted_px[i], float(radius_px[i]), residual_px[i] if used else None)
        for i, (name, used) in enumerate(zip(balls.ids, fit.used.tolist(), strict=True))
    )


def _ball(name: str, centre_px: NDArray[np.float64], radius_px: float, residual_px: float | None) -> DrawnBall:
    """A ball; one without a residual was not used."""
    return DrawnBall(
        id=name,
        centre_px=_pixel(centre_px),
        radius_px=round(radius_px, _DIGITS),
        used=residual_px is not None,
        residual_px=None if residual_px is None else round(float(residual_px), 3),
    )


def _nail_edges(nail: NailPart, camera_from_nail: Transform[Camera, Nail], view: _View) -> tuple[Polyline, ...]:
    places = axis_about_holes_mm(nail, OVERLAY.proximal_mm, OVERLAY.edge_step_mm)[:, 0].tolist()
    normals = touched_normals(nail, camera_from_nail)
    edges_mm = (
        np.stack([section_frame(nail.curvature_per_m, x_mm) @ (nail.radius_mm * normal) for x_mm in places])
        for normal in normals
    )
    return tuple(view.polyline(camera_from_nail.points(edge_mm)) for edge_mm in edges_mm)


def _holes(found: _Found, camera_from_nail: Transform[Camera, Nail], view: _View) -> tuple[DrawnHole, ...]:
    nail, guide = found.parts.nail, found.result.guide
    estimates = {estimate.id: estimate for estimate in found.result.holes or ()}
    localised = {hole.id for hole in nail.holes}
    drawn = []
    for hole in nail.all_holes:
        estimate = estimates.get(hole.id) if hole.id in localised else None
        entry, leaving = None, None
        if estimate is not None and guide is not None:
            entry, leaving = _ellipses(estimate, guide.camera_from_guide, view)
        ends = hole_surface_points(nail, hole)
        axis_mm = np.stack([ends[0] - OVERLAY.axis_mm * hole_axis(nail, hole).direction, ends[0], ends[1]])
        middle_mm = camera_from_nail.points(0.5 * (ends[0] + ends[1]))
        first, last = (
            view.polyline(camera_from_nail.points(np.vstack([rim, rim[:1]]))) for rim in rims_of(nail, hole, _angles())
        )
        drawn.append(
            DrawnHole(
                id=hole.id,
                localised=hole.id in localised,
                centre_px=_pixel(view.project(middle_mm)),
                mm_per_px=float(middle_mm[2]) / found.calibration.camera.focal_length_px,
                rims_px=(first, last),
                axis_px=view.polyline(camera_from_nail.points(axis_mm)),
                entry_95=entry,
                exit_95=leaving,
            )
        )
    return tuple(drawn)


def _ellipses(
    estimate: HoleEstimate, camera_from_guide: Transform[Camera, Guide], view: _View
) -> tuple[DrawnEllipse | None, DrawnEllipse | None]:
    """95 % ellipses of the axis's offset across itself at entry and exit."""
    if estimate.offset is None:
        return None, None
    covariance = estimate.offset.covariance_mm2
    across = camera_from_guide.directions(across_basis(estimate.axis_guide.direction))
    return (
        _ellipse(camera_from_guide.points(estimate.entry_guide_mm), across, covariance[:2, :2], view),
        _ellipse(camera_from_guide.points(estimate.exit_guide_mm), across, covariance[2:, 2:], view),
    )


def _ellipse(
    camera_mm: NDArray[np.float64], across: NDArray[np.float64], covariance_mm2: NDArray[np.float64], view: _View
) -> DrawnEllipse:
    """Project a covariance, shape (2, 2), along two directions of the camera frame, shape (2, 3)."""
    half_mm = 0.5
    ends_px = view.project(camera_mm + half_mm * np.concatenate([across, -across]))
    px_per_mm = (ends_px[:2] - ends_px[2:]).T
    values, vectors = np.linalg.eigh(px_per_mm @ covariance_mm2 @ px_per_mm.T)
    minor_px, major_px = QUANTILE_95 * np.sqrt(np.maximum(values, 0.0))
    x, y = vectors[:, 1]
    return DrawnEllipse(
        centre_px=_pixel(view.project(camera_mm)),
        semi_major_px=round(float(major_px), _DIGITS),
        semi_minor_px=round(float(minor_px), _DIGITS),
        major_axis_deg=float(np.degrees(np.arctan2(y, x))),
    )


def _drill_paths(found: _Found, fit: GuideFit, view: _View) -> tuple[DrawnPath, ...]:
    nail, parts = found.result.nail, found.parts
    holes = {} if nail is None else {hole.id: hole for hole in parts.nail.holes}
    drawn = []
    for hole in parts.guide.holes:
        axis = Line(fit.camera_from_guide @ hole.axis.point_mm, fit.camera_from_guide.directions(hole.axis.direction))
        namesake = holes.get(hole.id)
        crossings_mm = np.empty((0, 3))
        if nail is not None and namesake is not None:
            crossings_mm = _crossings(axis, parts.nail, namesake, nail.camera_from_nail)
        drawn.append(_path(hole.id, axis, crossings_mm, 0.5 * parts.drill_diameter_mm, view))
    return tuple(drawn)


def _crossings(
    axis: Line, nail: NailPart, hole: Hole, camera_from_nail: Transform[Camera, Nail]
) -> NDArray[np.float64]:
    """Where a line of the camera frame crosses the planes across a hole at its entry and exit, shape (2, 3)."""
    normal = camera_from_nail.directions(hole_axis(nail, hole).direction)
    ends_mm = camera_from_nail.points(np.stack(hole_surface_points(nail, hole)))
    return np.stack([axis.at_plane(end_mm, normal) for end_mm in ends_mm])


def _path(name: str, axis: Line, crossings_mm: NDArray[np.float64], radius_mm: float, view: _View) -> DrawnPath:
    half_mm = OVERLAY.guide_hole_mm
    ends_mm = axis.point_mm + np.array([[-half_mm], [half_mm]]) * axis.direction
    if len(crossings_mm):
        ends_mm = np.stack([crossings_mm[0] - OVERLAY.axis_mm * axis.direction, crossings_mm[1]])
    points_mm = np.linspace(ends_mm[0], ends_mm[1], OVERLAY.path_points)
    aside = radius_mm * unit(np.cross(axis.direction, unit(points_mm)))
    angle = _angles()[:, None]
    first, second = across_basis(axis.direction)
    circle_mm = radius_mm * (np.cos(angle) * first + np.sin(angle) * second)
    return DrawnPath(
        id=name,
        axis_px=view.polyline(points_mm),
        edges_px=(view.polyline(points_mm - aside), view.polyline(points_mm + aside)),
        rims_px=tuple(view.polyline(crossing_mm + circle_mm) for crossing_mm in crossings_mm),
    )


def _screws(site: MountingSite, view: _View) -> tuple[DrawnScrew, ...]:
    radius_px = round(0.5 * site.screw_diameter_px, _DIGITS)
    return tuple(
        DrawnScrew(id=one.id, shown=one.shown, axis_px=_polyline(view.place(one.axis_px)), radius_px=radius_px)
        for one in site.screws
    )


def _angles() -> NDArray[np.float64]:
    return np.linspace(0.0, 2.0 * np.pi, OVERLAY.rim_points)


def _polyline(px: NDArray[np.float64]) -> Polyline:
    return tuple(_pixel(point_px) for point_px in px)


def _pixel(px: NDArray[np.float64]) -> Pixel:
    return (round(float(px[0]), _DIGITS), round(float(px[1]), _DIGITS))

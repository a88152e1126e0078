"""Draw what was found on the image, for people: ring and guide balls, the nail's outline, holes and their axes."""

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.guide.locate import GuideFit
from services.registration.core.guide.measure import shadows
from services.registration.core.hole_axes import rims_of
from services.registration.core.localise import LocalisationResult, Parts, unmirrored
from services.registration.core.mounting_site import MountingSite
from services.registration.core.tuning import OVERLAY
from services.registration.core.wires.nail_outline import axis_about_holes_mm, touched_normals
from shared.geometry.bend import section_frame
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart, hole_axis, hole_surface_points
from shared.geometry.transform import Transform

Canvas = NDArray[np.uint8]
Colour = tuple[int, int, int]

# Colours of the drawing, blue-green-red as OpenCV wants them.
RING: Colour = (200, 160, 60)
GUIDE: Colour = (80, 200, 80)
LOST: Colour = (60, 60, 220)
NAIL: Colour = (0, 190, 255)
AXIS: Colour = (255, 80, 255)
SITE: Colour = (255, 220, 80)


def overlay_png(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration | None,
    result: LocalisationResult,
    parts: Parts,
    site: MountingSite | None = None,
) -> bytes:
    """PNG of the image as received, shape (rows, columns), with everything drawn on it that was found or advised."""
    if calibration is None:
        return _encoded(_canvas(pixels))
    canvas = _canvas(unmirrored(pixels, calibration))
    _draw_ring(canvas, calibration)
    if result.guide is not None:
        _draw_guide(canvas, calibration, result.guide, parts)
    if result.nail is not None:
        _draw_nail(canvas, calibration, result.nail.camera_from_nail, parts.with_nail_as_found(result.nail).nail)
    if site is not None:
        _draw_site(canvas, site)
    shown = np.ascontiguousarray(canvas[:, ::-1]) if calibration.mirrored else canvas
    _write(shown, _caption(result) + _site_caption(site))
    return _encoded(shown)


def _canvas(pixels: NDArray[np.float32]) -> Canvas:
    """The image in few grey levels (noise makes large files) as colours, shape (rows, columns, 3)."""
    low, high = np.percentile(pixels, [OVERLAY.darkest_percentile, OVERLAY.brightest_percentile])
    share = np.clip((pixels - low) / max(float(high - low), 1e-6), 0.0, 1.0)
    brightest = OVERLAY.grey_levels - 1
    levels = np.round(share * brightest) * (255.0 / brightest)
    return np.repeat(levels.astype(np.uint8)[:, :, None], 3, axis=2)


def _encoded(canvas: Canvas) -> bytes:
    done, content = cv2.imencode(".png", canvas)
    if not done:
        raise ValueError(f"an image of shape {canvas.shape} cannot be written as PNG")
    return bytes(content)


def _fixed_point(px: NDArray[np.float64]) -> NDArray[np.int32]:
    return np.round(px * (1 << OVERLAY.subpixel_bits)).astype(np.int32)


def _line(canvas: Canvas, px: NDArray[np.float64], colour: Colour) -> None:
    """Draw a polyline through pixels, shape (N, 2)."""
    cv2.polylines(
        canvas,
        [_fixed_point(px)],
        isClosed=False,
        color=colour,
        thickness=1,
        lineType=cv2.LINE_AA,
        shift=OVERLAY.subpixel_bits,
    )


def _circle(canvas: Canvas, centre_px: NDArray[np.float64], radius_px: float, colour: Colour) -> None:
    x, y = (int(v) for v in _fixed_point(centre_px))
    bits = OVERLAY.subpixel_bits
    cv2.circle(canvas, (x, y), int(radius_px * (1 << bits)), colour, 1, cv2.LINE_AA, bits)


def _draw_ring(canvas: Canvas, calibration: CArmCalibration) -> None:
    balls = calibration.balls
    for index in np.flatnonzero(balls.ring_index != NOT_OF_THE_RING):
        _circle(canvas, balls.centre_px[index], float(balls.radius_px[index]) + OVERLAY.ball_margin_px, RING)


def _draw_guide(canvas: Canvas, calibration: CArmCalibration, guide: GuideFit, parts: Parts) -> None:
    balls = shadows(calibration, parts.guide.balls, guide.camera_from_guide)
    for place, size, used in zip(balls.centre_px, balls.radius_px, guide.used, strict=True):
        _circle(canvas, place, float(size) + OVERLAY.ball_margin_px, GUIDE if used else LOST)
    for hole in parts.guide.holes:
        ends = hole.axis.point_mm + np.array([[-1.0], [1.0]]) * OVERLAY.guide_hole_mm * hole.axis.direction
        _line(canvas, calibration.image_from_camera(guide.camera_from_guide.points(ends)), GUIDE)


def _draw_nail(
    canvas: Canvas, calibration: CArmCalibration, camera_from_nail: Transform[Camera, Nail], nail: NailPart
) -> None:
    for normal in touched_normals(nail, camera_from_nail):
        places = axis_about_holes_mm(nail, OVERLAY.proximal_mm, OVERLAY.edge_step_mm)[:, 0].tolist()
        beside = nail.radius_mm * normal
        edge = np.stack([section_frame(nail.curvature_per_m, x_mm) @ beside for x_mm in places])
        _line(canvas, calibration.image_from_camera(camera_from_nail.points(edge)), NAIL)
    angle = np.linspace(0.0, 2.0 * np.pi, OVERLAY.rim_points)
    for hole in nail.all_holes:
        for rim in rims_of(nail, hole, angle):
            around = np.vstack([rim, rim[:1]])  # a slot's last straight piece
            _line(canvas, calibration.image_from_camera(camera_from_nail.points(around)), NAIL)
    for hole in nail.holes:
        ends = hole_surface_points(nail, hole)
        axis = np.stack([ends[0] - OVERLAY.axis_mm * hole_axis(nail, hole).direction, ends[1]])
        _line(canvas, calibration.image_from_camera(camera_from_nail.points(axis)), AXIS)


def _draw_site(canvas: Canvas, site: MountingSite) -> None:
    """Draw where the base's middle may be, and both screws with their axes."""
    _line(canvas, site.range_px, SITE)
    for screw in site.screws:
        _line(canvas, screw.axis_px, SITE)
        for end in screw.axis_px:
            _circle(canvas, end, 0.5 * site.screw_diameter_px, SITE)


def _site_caption(site: MountingSite | None) -> list[str]:
    if site is None:
        return []
    places = " and ".join(f"{screw.proximal_mm:.0f}" for screw in site.screws)
    lines = [f"mount: screws {places} mm proximal of the holes' middle, head at {site.head_extension_mm:.0f} mm"]
    return lines if site.shown else [*lines, "the image does not show this place: move the C-arm proximally"]


def _caption(result: LocalisationResult) -> list[str]:
    lines = ["accepted" if result.accepted else "rejected: " + ", ".join(r.code.value for r in result.reasons)]
    for hole in result.holes or ():
        text = f"{hole.id}: tilt {hole.tilt_to_ray_deg:.1f} deg"
        if hole.offset is not None:
            text += f", +-{hole.offset.entry_sd_mm:.2f} mm +-{hole.offset.axis_sd_deg:.2f} deg"
        lines.append(text)
    return lines


def _write(canvas: Canvas, lines: list[str]) -> None:
    for row, text in enumerate(lines):
        place = (10, 24 + 20 * row)
        cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 3, cv2.LINE_AA)
        cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)

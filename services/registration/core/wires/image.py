"""One X-ray image prepared for measuring K-wires: its slopes, and where the view on a wire is free."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.subpixel import between_pixels
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform

_GRID_STEP_PX = 2
_METAL_MM = 0.4
MARGIN_PX = 2.0
_BORDER_PX = 6.0
_BLUR_PX = 1.2
_MEDIAN_OF_RAYLEIGH = 1.1774
# The display burns out where this share of the pixels around is within so much of its range of the brightest.
_BURNT_SHARE, _BURNT_AROUND_PX, _BURNT_WITHIN = 0.25, 7, 0.004
_BESIDE_BURNT_MM = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class WireView:
    """An image with wires, and where the guide is in it.

    Attributes
    ----------
    pixels
        Un-mirrored image, shape (height, width), darker is denser.
    guide_covariance
        Of `camera_from_guide`: a small rotation (rad), then translation (mm), in the guide's own frame, shape (6, 6).
    """

    pixels: NDArray[np.float32]
    calibration: CArmCalibration
    camera_from_guide: Transform[Camera, Guide]
    guide_covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PreparedView:
    """A view with what the wire fit reads from it.

    Attributes
    ----------
    smooth, slope_x, slope_y
        Lightly smoothed image and its derivatives, per pixel, shape (height, width).
    free
        0 where nail, balls, the image's border or a burnt-out display hide a wire, else 1, shape (height, width).
    noise
        Robust spread of the slope in the free part of the image (texture and noise).
    metal_grey
        Grey value of the nail's metal.
    rotation, translation_mm
        `camera_from_guide`, taken apart once because a fit uses it thousands of times.
    """

    view: WireView
    smooth: NDArray[np.float32]
    slope_x: NDArray[np.float32]
    slope_y: NDArray[np.float32]
    free: NDArray[np.float32]
    noise: float
    metal_grey: float
    rotation: NDArray[np.float64]
    translation_mm: NDArray[np.float64]

    def camera_points_mm(self, points_guide_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points of the guide's frame, shape (..., 3), in the camera's."""
        return points_guide_mm @ self.rotation.T + self.translation_mm

    def free_share(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """How free the view is at points, shape (..., 2), between the pixels about them: from 0 to 1, shape (...)."""
        return between_pixels(self.free, points_px)

    def grey(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Grey values of the smoothed image at points, shape (..., 2); shape (...)."""
        return between_pixels(self.smooth, points_px)

    def outward_slope(self, points_px: NDArray[np.float64], outward: NDArray[np.float64]) -> NDArray[np.float64]:
        """Slope along directions, shape (M, S, 2), at points, shape (M, S, 2); positive where it gets brighter."""
        along_x, along_y = (between_pixels(slope, points_px) for slope in (self.slope_x, self.slope_y))
        return along_x * outward[..., 0] + along_y * outward[..., 1]


def prepare_view(
    view: WireView,
    guide: GuidePart,
    nail: NailPart,
    guide_from_nail: Transform[Guide, Nail],
    margin_px: float = MARGIN_PX,
) -> PreparedView:
    """Mask what hides the wires (the nail where it is not open, balls, the border, white) and take the image's slopes.

    Parameters
    ----------
    margin_px
        How far around the nail the mask reaches: as far as its place is uncertain.
    """
    smooth = np.asarray(cv2.GaussianBlur(view.pixels.astype(np.float32), (0, 0), _BLUR_PX), dtype=np.float32)
    slope_x = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=0.125), dtype=np.float32)
    slope_y = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=0.125), dtype=np.float32)
    pose = view.camera_from_guide
    metal = _metal(view, nail, pose @ guide_from_nail, margin_px)
    bright = in_border(view.calibration)
    free = bright & ~metal & ~balls_mask(view, guide) & ~burnt_out(view)
    steepness = np.hypot(slope_x[free], slope_y[free])
    noise = float(np.median(steepness)) / _MEDIAN_OF_RAYLEIGH if steepness.size else 1.0
    metal_grey = float(np.percentile(smooth[metal & bright], 20)) if (metal & bright).any() else 0.0
    return PreparedView(
        view,
        smooth,
        slope_x,
        slope_y,
        free.astype(np.float32),
        max(noise, 1e-12),
        metal_grey,
        pose.rotation,
        pose.translation_mm,
    )


def _metal(
    view: WireView, nail: NailPart, camera_from_nail: Transform[Camera, Nail], margin_px: float
) -> NDArray[np.bool_]:
    calibration = view.calibration
    x = np.arange(0, calibration.width_px + _GRID_STEP_PX, _GRID_STEP_PX, dtype=np.float64)
    y = np.arange(0, calibration.height_px + _GRID_STEP_PX, _GRID_STEP_PX, dtype=np.float64)
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    length_mm = metal_length_mm(calibration.rays_camera(grid), nail, camera_from_nail)
    columns, rows = np.meshgrid(
        *(np.arange(n, dtype=np.float32) for n in (calibration.width_px, calibration.height_px))
    )
    full = cv2.remap(length_mm.astype(np.float32), columns / _GRID_STEP_PX, rows / _GRID_STEP_PX, cv2.INTER_LINEAR)
    size = 2 * int(np.ceil(margin_px)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray(cv2.dilate((full > _METAL_MM).astype(np.uint8), kernel) > 0)


def metal_length_mm(
    rays_camera: NDArray[np.float64], nail: NailPart, camera_from_nail: Transform[Camera, Nail]
) -> NDArray[np.float64]:
    """Length of rays, unit directions of shape (..., 3), in an endless nail with its holes, shape (...), in mm.

    The cannulation counts as metal: it is not open.
    """
    nail_from_camera = camera_from_nail.inverse()
    source, rays = nail_from_camera.translation_mm, nail_from_camera.directions(rays_camera)
    near, far = _inside(source, rays, np.array([1.0, 0.0, 0.0]), nail.radius_mm)
    length = np.maximum(far - near, 0.0)
    for hole in nail.holes:
        first, last = _inside(source - hole.axis.point_mm, rays, hole.axis.direction, 0.5 * hole.diameter_mm)
        length = length - np.maximum(np.minimum(last, far) - np.maximum(first, near), 0.0)
    return np.asarray(np.maximum(length, 0.0))


def _inside(
    origin_mm: NDArray[np.float64], rays: NDArray[np.float64], axis: NDArray[np.float64], radius_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where rays are inside an endless cylinder through the origin: along them from `origin_mm`; empty as (0, -1)."""
    across = rays - (rays @ axis)[..., None] * axis
    offset = origin_mm - (origin_mm @ axis) * axis
    a = np.maximum((across**2).sum(axis=-1), 1e-18)
    b = across @ offset
    discriminant = b * b - a * (float(offset @ offset) - radius_mm**2)
    root = np.sqrt(np.maximum(discriminant, 0.0))
    hit = discriminant > 0.0
    return np.where(hit, (-b - root) / a, 0.0), np.where(hit, (-b + root) / a, -1.0)


def balls_mask(view: WireView, guide: GuidePart) -> NDArray[np.bool_]:
    """Where balls of guide and ring hide what is behind them, shape (height, width)."""
    calibration = view.calibration
    mask = np.zeros((calibration.height_px, calibration.width_px), dtype=np.uint8)
    in_camera_mm = view.camera_from_guide.points(guide.balls.position_mm)
    guide_px = calibration.image_from_camera(in_camera_mm)
    radii_px = 0.5 * guide.balls.diameter_mm * calibration.camera.focal_length_px / in_camera_mm[:, 2]
    ring = calibration.balls.ring_index != NOT_OF_THE_RING
    centres = np.concatenate([guide_px, calibration.balls.centre_px[ring]])
    radii = np.concatenate([radii_px, calibration.balls.radius_px[ring]])
    for (x, y), radius in zip(centres, radii, strict=True):
        cv2.circle(mask, (round(float(x)), round(float(y))), int(np.ceil(radius + MARGIN_PX)), 1, thickness=-1)
    return np.asarray(mask > 0)


def burnt_out(view: WireView) -> NDArray[np.bool_]:
    """Where the display has burnt out, or a wire on white would be seen narrower than it is, shape (height, width).

    There a wire seems to thin out and to end, long before its end.
    """
    darkest, brightest = float(view.pixels.min()), float(view.pixels.max())
    white = (view.pixels >= brightest - _BURNT_WITHIN * (brightest - darkest)).astype(np.float32)
    share = cv2.blur(white, (_BURNT_AROUND_PX, _BURNT_AROUND_PX))
    depth_mm = float(view.camera_from_guide.translation_mm[2])
    reach = int(np.ceil(_BESIDE_BURNT_MM * view.calibration.camera.focal_length_px / depth_mm))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return np.asarray(cv2.dilate((share > _BURNT_SHARE).astype(np.uint8), kernel) > 0)


def in_border(calibration: CArmCalibration) -> NDArray[np.bool_]:
    """Where the image shows something, away from its border and aperture, shape (height, width)."""
    columns, rows = np.arange(float(calibration.width_px)), np.arange(float(calibration.height_px))
    return calibration.shows(columns, rows[:, None], _BORDER_PX)

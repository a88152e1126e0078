"""An X-ray image prepared for measuring K-wires: its gradient, and where a wire would be visible."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.guide.measure import shadows
from services.registration.core.nail.left_out import widened
from services.registration.core.tuning import WIRE_VISIBILITY
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.parts import GuidePart, Hole, NailPart
from shared.geometry.transform import Transform
from shared.xray.pixel_scale import pixels, whole_pixels

# Median over the scale parameter of a Rayleigh distribution: the norm of two normal slopes has that distribution.
_MEDIAN_OF_RAYLEIGH = 1.1774


@dataclass(frozen=True, slots=True, eq=False)
class RegisteredImage:
    """An X-ray image registered to the guide."""

    pixels: NDArray[np.float32]  # un-mirrored image, shape (height, width), darker is denser
    calibration: CArmCalibration
    camera_from_guide: Transform[Camera, Guide]
    # Of `camera_from_guide`: a small rotation (rad), then translation (mm), in the guide's own frame, shape (6, 6)
    guide_covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class GradientImage:
    """A registered image with its gradient and the mask of where a wire would be visible."""

    registered: RegisteredImage
    # Lightly smoothed image and its derivatives, per pixel, shape (height, width)
    smooth: NDArray[np.float32]
    slope_x: NDArray[np.float32]
    slope_y: NDArray[np.float32]
    # 0 where nail, balls, the image's border or a saturated display hide a wire, else 1, shape (height, width)
    visible: NDArray[np.float32]
    noise: float  # robust standard deviation of the slope where a wire would be visible (texture and noise)
    metal_grey: float  # grey value of the nail's metal

    def length_px(self, length_detector_mm: float) -> float:
        """A length at the detector in pixels of this image."""
        return pixels(length_detector_mm, self.registered.calibration.pixel_mm)


def gradient_image(
    registered: RegisteredImage,
    guide: GuidePart,
    nail: NailPart,
    guide_from_nail: Transform[Guide, Nail],
    margin_detector_mm: float,
) -> GradientImage:
    """Mask what hides wires (the nail outside its holes, balls, border, saturation) and compute the image's gradient.

    The margin of the mask around the nail is as large as its place is uncertain.
    """
    calibration = registered.calibration
    smooth = smoothed(registered, WIRE_VISIBILITY.blur_detector_mm)
    slope_x = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=0.125), dtype=np.float32)
    slope_y = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=0.125), dtype=np.float32)
    camera_from_nail = registered.camera_from_guide @ guide_from_nail
    metal = _metal(calibration, nail, camera_from_nail, pixels(margin_detector_mm, calibration.pixel_mm))
    shown = shown_pixels(calibration)
    visible = shown & ~metal & ~balls_mask(registered, guide) & ~saturated(registered)
    steepness = np.hypot(slope_x[visible], slope_y[visible])
    noise = float(np.median(steepness)) / _MEDIAN_OF_RAYLEIGH if steepness.size else 1.0
    dark = smooth[metal & shown]
    return GradientImage(
        registered=registered,
        smooth=smooth,
        slope_x=slope_x,
        slope_y=slope_y,
        visible=visible.astype(np.float32),
        noise=max(noise, 1e-12),  # divides the slopes
        metal_grey=float(np.percentile(dark, WIRE_VISIBILITY.metal_grey_percentile)) if dark.size else 0.0,
    )


def smoothed(registered: RegisteredImage, blur_detector_mm: float) -> NDArray[np.float32]:
    """The image after a Gaussian blur, shape (height, width)."""
    blur_px = pixels(blur_detector_mm, registered.calibration.pixel_mm)
    return np.asarray(cv2.GaussianBlur(registered.pixels.astype(np.float32), (0, 0), blur_px), dtype=np.float32)


def _metal(
    calibration: CArmCalibration, nail: NailPart, camera_from_nail: Transform[Camera, Nail], margin_px: float
) -> NDArray[np.bool_]:
    """Where the nail, dilated by a margin, hides a wire, shape (height, width)."""
    step = whole_pixels(WIRE_VISIBILITY.metal_grid_detector_mm, calibration.pixel_mm)
    x = np.arange(0, calibration.width_px + step, step, dtype=np.float64)
    y = np.arange(0, calibration.height_px + step, step, dtype=np.float64)
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    length_mm = metal_length_mm(calibration.rays_camera(grid), nail, camera_from_nail)
    columns, rows = np.meshgrid(
        *(np.arange(n, dtype=np.float32) for n in (calibration.width_px, calibration.height_px))
    )
    full = cv2.remap(length_mm.astype(np.float32), columns / step, rows / step, cv2.INTER_LINEAR)
    return widened(full > WIRE_VISIBILITY.least_metal_mm, int(np.ceil(margin_px)))


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
    for hole in nail.all_holes:
        first, last = _open(source - hole.axis.point_mm, rays, hole)
        length = length - np.maximum(np.minimum(last, far) - np.maximum(first, near), 0.0)
    return np.asarray(np.maximum(length, 0.0))


def _open(
    origin_mm: NDArray[np.float64], rays: NDArray[np.float64], hole: Hole
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where rays are inside a hole: of a slot, in any of some bores side by side."""
    radius_mm = 0.5 * hole.diameter_mm
    count = 1 + 2 * int(np.ceil(hole.half_slot_mm / radius_mm))
    first, last = np.full(rays.shape[:-1], np.inf), np.full(rays.shape[:-1], -np.inf)
    for shift_mm in np.linspace(-hole.half_slot_mm, hole.half_slot_mm, count):
        near, far = _inside(origin_mm - shift_mm * hole.along_nail(), rays, hole.axis.direction, radius_mm)
        hit = far > near
        first, last = np.where(hit, np.minimum(first, near), first), np.where(hit, np.maximum(last, far), last)
    return first, last


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


def balls_mask(registered: RegisteredImage, guide: GuidePart) -> NDArray[np.bool_]:
    """Where balls of guide and ring, with a margin, hide what is behind them, shape (height, width)."""
    calibration = registered.calibration
    of_guide = shadows(calibration, guide.balls, registered.camera_from_guide)
    ring = calibration.balls.ring_index != NOT_OF_THE_RING
    centre_px = np.concatenate([of_guide.centre_px, calibration.balls.centre_px[ring]])
    radius_px = np.concatenate([of_guide.radius_px, calibration.balls.radius_px[ring]])
    margin_px = pixels(WIRE_VISIBILITY.margin_detector_mm, calibration.pixel_mm)
    return discs_mask(registered, np.column_stack([centre_px, radius_px + margin_px]))


def discs_mask(registered: RegisteredImage, discs_px: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Pixels in discs, centre and radius of shape (N, 3); shape (height, width)."""
    mask = np.zeros(registered.pixels.shape, dtype=np.uint8)
    for x, y, radius in discs_px.tolist():
        cv2.circle(mask, (round(x), round(y)), int(np.ceil(radius)), 1, thickness=-1)
    return np.asarray(mask > 0)


def saturated(registered: RegisteredImage) -> NDArray[np.bool_]:
    """Where the display is saturated, or a wire beside white would appear too narrow, shape (height, width).

    There a wire seems to thin out and to end, long before its end.
    """
    image, calibration = registered.pixels, registered.calibration
    darkest, brightest = float(image.min()), float(image.max())
    white = (image >= brightest - WIRE_VISIBILITY.saturated_range * (brightest - darkest)).astype(np.float32)
    width_px = whole_pixels(WIRE_VISIBILITY.saturated_neighbourhood_detector_mm, calibration.pixel_mm)
    fraction = cv2.blur(white, (width_px, width_px))
    depth_mm = float(registered.camera_from_guide.translation_mm[2])
    reach_px = WIRE_VISIBILITY.beside_saturated_mm * calibration.camera.focal_length_px / depth_mm
    return widened(fraction > WIRE_VISIBILITY.saturated_fraction, int(np.ceil(reach_px)))


def shown_pixels(calibration: CArmCalibration) -> NDArray[np.bool_]:
    """Pixels inside image and aperture, less a margin from their borders, shape (height, width)."""
    columns, rows = np.arange(float(calibration.width_px)), np.arange(float(calibration.height_px))
    margin_px = pixels(WIRE_VISIBILITY.border_detector_mm, calibration.pixel_mm)
    return calibration.shows(columns, rows[:, None], margin_px)

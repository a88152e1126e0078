"""Where the drill guide is: its balls identified, measured where they must be, and fitted."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import (
    GUIDE_BALLS,
    GUIDE_DISPLACEMENT,
    GUIDE_FOCAL_LENGTH,
    GUIDE_IDENTITY,
    GUIDE_MARGIN,
)
from services.registration.core.estimation.image_points import Correspondences, reprojection_rms_px
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.estimation.shared_image_errors import fit_with_shared_errors
from services.registration.core.guide.as_built import (
    FocalLength,
    beside_px2,
    displacement_sd_mm,
    focal_length_of,
    px_per_mm,
)
from services.registration.core.guide.identity import GuideIdentity, candidate_discs, needed_balls
from services.registration.core.guide.lag import lag_px
from services.registration.core.guide.measure import (
    GuideImage,
    Measured,
    measured_and_fitted,
    measured_displaced,
    predicted_within_px,
    ring_shadows,
    shrinkage,
)
from services.registration.core.guide.search import search_guide
from services.registration.core.tuning import GUIDE_AS_BUILT, GUIDE_MEASUREMENT
from shared.errors import Accepted, Reason, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide
from shared.geometry.lines import read_only
from shared.geometry.parts import GuidePart, RingPart
from shared.geometry.transform import Transform
from shared.xray.aperture import usable_pixels
from shared.xray.noise_filter import noise_whitened
from shared.xray.pixel_scale import pixels as pixels_of


@dataclass(frozen=True, slots=True, eq=False)
class GuideFit:
    """The guide found in one image."""

    # The errors of the distortion are in its covariance, those of the camera's intrinsics are not (see
    # `guide_from_nail`)
    pose: PoseEstimate[Camera, Guide]
    used: NDArray[np.bool_]  # balls from which the pose is estimated, shape (N,)
    # Undistorted pixels, shape (N, 2), and the standard deviations of the balls' own errors, shape (N,), as the fit
    # used them
    ideal_px: NDArray[np.float64]
    standard_deviation_px: NDArray[np.float64]
    balls_expected: int
    reprojection_rms_px: float
    runner_up_margin: int  # balls that the identity explains, minus those of the best different one
    focal_length: FocalLength  # as the balls give it, beside the calibration's
    # Spread of the balls' places about their file's that neither measurement nor the stated tolerance explains, per
    # axis; it is in the standard deviations above
    displacement_sd_mm: float = 0.0
    lag_px: float = 0.0  # how far the balls' shadows reach to one side: earlier frames are in the image

    @property
    def camera_from_guide(self) -> Transform[Camera, Guide]:
        """The pose without its errors."""
        return self.pose.mean

    @property
    def balls_found(self) -> int:
        """Number of balls from which the pose is estimated."""
        return int(np.count_nonzero(self.used))


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A chosen identity of the guide's balls, its `GuideFit.runner_up_margin`, and how many must then be measured."""

    identity: GuideIdentity
    margin: int
    needed: int


def locate_guide(
    pixels: NDArray[np.float32], calibration: CArmCalibration, ring: RingPart, guide: GuidePart
) -> Accepted[GuideFit] | Rejected:
    """Find the guide in an un-mirrored image, shape (rows, columns), or report why it is not found.

    The candidates are the discs of the calibration that are not of the ring.
    """
    candidates = candidate_discs(calibration, guide)
    identities = guide_identities(calibration, guide)
    refusal = _identity_reason(identities, len(candidates), len(guide.balls))
    if refusal is not None:
        return Rejected((refusal,))
    needed = needed_balls(len(guide.balls))
    return measured_guide(pixels, calibration, ring, guide, Named(identities[0], _margin(identities), needed))


def guide_identities(calibration: CArmCalibration, guide: GuidePart) -> list[GuideIdentity]:
    """Ways to name discs of an image as balls of the guide, best first."""
    candidates = candidate_discs(calibration, guide)
    ideal_px = calibration.distortion.undistort(calibration.balls.centre_px[candidates])
    return search_guide(calibration.camera, guide.balls.position_mm, ideal_px, calibration.pixel_mm)


def measured_guide(
    pixels: NDArray[np.float32], calibration: CArmCalibration, ring: RingPart, guide: GuidePart, named: Named
) -> Accepted[GuideFit] | Rejected:
    """Measure all balls where a chosen identity puts them, and fit the pose to those that are seen."""
    best, candidates = named.identity, candidate_discs(calibration, guide)
    shrunk = shrinkage(calibration, guide, best, calibration.balls.radius_px[candidates])
    usable = usable_pixels(pixels, calibration.aperture)
    around = calibration.image_from_camera(best.camera_from_guide.points(guide.balls.position_mm))
    surroundings_px = pixels_of(GUIDE_MEASUREMENT.surroundings_detector_mm, calibration.pixel_mm)
    quiet = noise_whitened(pixels, usable, around, surroundings_px)
    image = GuideImage(quiet, usable, calibration, guide, ring_shadows(calibration, ring), shrunk)
    fit = _fitted_as_built(image, named)
    if isinstance(fit, Rejected):
        return fit
    if not GUIDE_DISPLACEMENT.is_met(fit.displacement_sd_mm):
        return Rejected((_displacement_reason(guide, fit),))
    if not GUIDE_FOCAL_LENGTH.is_met(abs(fit.focal_length.sigmas(calibration.focal_length_deviation))):
        return Rejected((_focal_length_reason(calibration, fit),))
    return Accepted(replace(fit, lag_px=lag_px(image, pixels, fit.camera_from_guide, fit.used)))


def _fitted_as_built(image: GuideImage, named: Named) -> GuideFit | Rejected:
    """The fit to balls that were each looked for as far from its filed place as the others lie from theirs."""
    fit, displaced_px = _fitted(image, measured_and_fitted(image, named.identity), named), 0.0
    for _ in range(GUIDE_AS_BUILT.most_rounds):
        if isinstance(fit, Rejected):
            break
        before_px, displaced_px = displaced_px, _displacement_sd_px(image.calibration, image.guide, fit)
        grown = predicted_within_px(image, displaced_px) / predicted_within_px(image, before_px)
        if grown < GUIDE_AS_BUILT.grown:
            break
        fit = _fitted(image, measured_displaced(image, fit.camera_from_guide, displaced_px), named)
    return fit


def _fitted(image: GuideImage, measured: Measured, named: Named) -> GuideFit | Rejected:
    """The fit to balls that were measured, unless they are too few."""
    pose, seen, used = measured
    found = int(np.count_nonzero(used))
    if found < named.needed:
        quoted = GUIDE_BALLS.quoted(found, named.needed)
        balls = len(image.guide.balls)
        return Rejected((GUIDE_BALLS.reason(f"of the guide's {balls} balls {quoted} could be measured"),))
    return _guide_fit(image.calibration, image.guide, pose, seen, used, named.margin)


def _displacement_sd_px(calibration: CArmCalibration, guide: GuidePart, fit: GuideFit) -> float:
    """By how many pixels the balls lie beside their filed places, those included that were not found for that."""
    if fit.displacement_sd_mm == 0.0:
        return 0.0
    middle_mm, discs = np.zeros((1, 3)), candidate_discs(calibration, guide)
    scale = float(px_per_mm(calibration.camera, fit.camera_from_guide, middle_mm)[0])
    beside = beside_px2(
        calibration.camera.project(fit.camera_from_guide.points(guide.balls.position_mm)),
        fit.used,
        calibration.distortion.undistort(calibration.balls.centre_px[discs]),
        calibration.balls.standard_deviation_px[discs],
        GUIDE_AS_BUILT.beside_mm * scale,
    )
    per_axis = fit.balls_found * (fit.displacement_sd_mm * scale) ** 2 + 0.5 * float(beside.sum())
    return float(np.sqrt(per_axis / (fit.balls_found + len(beside))))


def _margin(identities: list[GuideIdentity]) -> int:
    if not identities:
        return 0
    return len(identities[0]) - (len(identities[1]) if len(identities) > 1 else 0)


def _identity_reason(identities: list[GuideIdentity], discs: int, balls: int) -> Reason | None:
    """Refuse an identity with too few balls, or with no more than chance explains; a wrong file explains a few."""
    best, needed, margin = len(identities[0]) if identities else 0, needed_balls(balls), _margin(identities)
    by_chance = best < needed and not GUIDE_MARGIN.is_met(margin)
    if by_chance or not GUIDE_IDENTITY.is_met(best, min(GUIDE_IDENTITY.limit.value, needed)):
        quoted = GUIDE_IDENTITY.quoted(best, needed if by_chance else min(GUIDE_IDENTITY.limit.value, needed))
        return GUIDE_IDENTITY.reason(
            f"the guide's pattern of {balls} balls explains {quoted} of {discs} discs that are not the ring's"
        )
    if not GUIDE_MARGIN.is_met(margin):
        return GUIDE_MARGIN.reason(
            f"two different positions of the guide explain {best} and {best - margin} discs, a difference of "
            f"{GUIDE_MARGIN.quoted(margin)}"
        )
    return None


def _guide_fit(
    calibration: CArmCalibration,
    guide: GuidePart,
    pose: Transform[Camera, Guide],
    seen: Correspondences,
    used: NDArray[np.bool_],
    margin: int,
) -> GuideFit:
    shared = _shared_error(calibration, seen.chosen(used))
    spread_mm = displacement_sd_mm(calibration.camera, pose, seen.chosen(used), shared)
    if spread_mm > 0.0:
        spread_px = spread_mm * px_per_mm(calibration.camera, pose, seen.body_mm)
        seen = Correspondences(seen.body_mm, seen.ideal_px, np.hypot(seen.standard_deviation_px, spread_px))
    chosen = seen.chosen(used)
    fit = fit_with_shared_errors(calibration.camera, pose, chosen, shared)
    return GuideFit(
        pose=PoseEstimate(fit.mean, fit.errors.with_more(_frame_covariance(guide))),
        used=used,
        ideal_px=read_only(seen.ideal_px),
        standard_deviation_px=read_only(seen.standard_deviation_px),
        balls_expected=len(guide.balls),
        reprojection_rms_px=reprojection_rms_px(calibration.camera, fit.mean, chosen),
        runner_up_margin=margin,
        displacement_sd_mm=spread_mm,
        focal_length=focal_length_of(calibration.camera, fit.mean, chosen, shared),
    )


def _frame_covariance(guide: GuidePart) -> NDArray[np.float64]:
    """Covariance of the guide's pose by the place of all its balls together against its holes, shape (6, 6)."""
    turn, shift = np.radians(guide.frame_tolerance_deg or 0.0), guide.frame_tolerance_mm or 0.0
    return np.diag(np.square([turn] * 3 + [shift] * 3))


def _displacement_reason(guide: GuidePart, fit: GuideFit) -> Reason:
    """Name what the image and the guide's file disagree about."""
    observed = (
        f"beyond their measurement the guide's balls lie {GUIDE_DISPLACEMENT.quoted(fit.displacement_sd_mm)} from "
        "where its file puts them"
    )
    if fit.focal_length.explained < GUIDE_AS_BUILT.explained_by_planes:
        return GUIDE_DISPLACEMENT.reason(f"{observed}: displaced balls")
    apart_mm = -fit.focal_length.excess * float(np.ptp(guide.balls.position_mm[:, 2]))
    return GUIDE_DISPLACEMENT.reason(
        f"{observed}, and {100 * fit.focal_length.explained:.0f} % of that are planes of balls {abs(apart_mm):.1f} mm "
        f"{'farther apart' if apart_mm > 0.0 else 'nearer'} than in the file"
    )


def _focal_length_reason(calibration: CArmCalibration, fit: GuideFit) -> Reason:
    """Name both focal lengths."""
    given_px = calibration.camera.focal_length_px
    sigmas = fit.focal_length.sigmas(calibration.focal_length_deviation)
    return GUIDE_FOCAL_LENGTH.reason(
        f"the ring gives a focal length of {given_px:.0f} px, the guide's balls one of "
        f"{given_px * (1.0 + fit.focal_length.excess):.0f} px, {GUIDE_FOCAL_LENGTH.quoted(abs(sigmas))} apart"
    )


def distortion_correlation_px(calibration: CArmCalibration) -> float:
    """Distance over which errors of the distortion are correlated, in pixels of this image."""
    return pixels_of(GUIDE_MEASUREMENT.distortion_correlation_detector_mm, calibration.pixel_mm)


def _shared_error(calibration: CArmCalibration, chosen: Correspondences) -> NDArray[np.float64]:
    """Covariance per axis of the distortion's error at the balls: neighbours share it, shape (N, N)."""
    measured_px = calibration.distortion.distort(chosen.ideal_px)
    apart = np.linalg.norm(measured_px[:, None] - measured_px[None], axis=-1)
    deviation = calibration.distortion.standard_deviation_at(measured_px)
    correlation = np.exp(-0.5 * (apart / distortion_correlation_px(calibration)) ** 2)
    return np.asarray(deviation[:, None] * deviation[None] * correlation)

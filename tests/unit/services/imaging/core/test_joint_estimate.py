import numpy as np
import pytest

from services.imaging.core.calibration import similarity_near
from services.imaging.core.distortion_field import (
    Hyperparameters,
    RestrictedLikelihood,
    correlation,
    distances_px,
    most_likely_hyperparameters,
    polynomial,
)
from services.imaging.core.joint_estimate import (
    JointEstimate,
    NominalSource,
    Observations,
    estimate_jointly,
    on_plane,
)
from tests.unit.services.imaging.synthetic import Scene, default_ring, to_measured

START_MM = np.array([0.0, 0.0, -975.0])
NOMINAL = NominalSource(START_MM, np.array([100.0, 100.0, 150.0]))


def estimate_of(scene: Scene, seed: int, deviation_px: float, outliers: int = 0) -> JointEstimate:
    rng = np.random.default_rng(seed)
    position = default_ring().balls.position_mm
    measured = to_measured(scene, on_plane(position, np.array(scene.source_mm)))
    measured = measured + rng.normal(0.0, deviation_px, measured.shape)
    measured[:outliers] += 2.0
    gauge = similarity_near(on_plane(position, START_MM), measured, np.array([511.5, 511.5]), 256.0)
    observations = Observations(measured, np.full(len(measured), deviation_px), position)
    return estimate_jointly(observations, START_MM, NOMINAL, gauge)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_source_is_found_through_distortion(seed: int) -> None:
    scene = Scene(source_mm=(9.0, -12.0, -940.0), pincushion=0.06, bend_px=5.0)
    estimate = estimate_of(scene, seed, 0.05)
    error = estimate.source_mm - np.array(scene.source_mm)
    deviation = np.sqrt(np.diag(estimate.source_covariance_mm2))
    assert np.hypot(*error[:2]) < 0.15
    assert abs(error[2]) < 1.5
    assert (np.abs(error) < 4.0 * deviation).all()
    assert deviation[2] < 1.0


def test_predicted_uncertainty_of_the_source_is_honest() -> None:
    scene = Scene(source_mm=(-5.0, 8.0, -990.0), pincushion=0.05, bend_px=3.0)
    normalised = []
    for seed in range(20):
        estimate = estimate_of(scene, 100 + seed, 0.05)
        error = estimate.source_mm - np.array(scene.source_mm)
        normalised.append(error @ np.linalg.solve(estimate.source_covariance_mm2, error) / 3.0)
    assert 0.5 < np.mean(normalised) < 1.7


def test_balls_that_disagree_are_left_out() -> None:
    estimate = estimate_of(Scene(), 4, 0.05, outliers=5)
    assert not estimate.used[:5].any()
    assert estimate.used[5:].mean() > 0.97


@pytest.mark.parametrize("seed", range(4))
def test_distortion_is_found_beside_balls_that_are_displaced(seed: int) -> None:
    """A search that starts from the noise of a ring as filed may end where all is noise."""
    displaced_px, predicted_px = 0.8, 0.02
    scene, position = Scene(pincushion=0.06, bend_px=5.0), default_ring().balls.position_mm
    measured = to_measured(scene, on_plane(position, np.array(scene.source_mm)))
    measured = measured + np.random.default_rng(seed).normal(0.0, displaced_px, measured.shape)
    gauge = similarity_near(on_plane(position, START_MM), measured, np.array([511.5, 511.5]), 256.0)
    observations = Observations(measured, np.full(len(measured), predicted_px), position)
    solution = estimate_jointly(observations, START_MM, NOMINAL, gauge).solution
    found, likelihood = solution.prior, RestrictedLikelihood(solution.system, solution.prior.order)
    length_px = 0.5 * solution.system.half_size_px
    others = [
        Hyperparameters(found.order, amplitude_px, length_px, displaced_px / predicted_px) for amplitude_px in (0.1, 2)
    ]
    best = max(likelihood.of(most_likely_hyperparameters(solution.system, start, 300)) for start in others)
    assert likelihood.of(found) > best - 1.0


def test_the_field_leads_from_measured_to_ideal_pixels_with_honest_deviation() -> None:
    scene = Scene(pincushion=0.05, bend_px=5.0)
    estimate = estimate_of(scene, 5, 0.05)
    rng = np.random.default_rng(6)
    plane = rng.uniform(-70.0, 70.0, (200, 2))
    measured = to_measured(scene, plane)
    displacement, deviation = estimate.solution.predict(measured)
    error = measured + displacement - estimate.gauge.pixels(plane)
    assert np.sqrt(np.mean(error**2)) < 0.08
    assert np.sqrt(np.mean((error / deviation[:, None]) ** 2)) < 1.6
    _, far = estimate.solution.predict(np.array([[1200.0, 1200.0]]))
    assert far[0] > 5.0 * np.median(deviation)


def test_left_out_residuals_are_those_of_a_fit_without_the_ball() -> None:
    scene = Scene()
    position = default_ring().balls.position_mm[:60]
    rng = np.random.default_rng(7)
    measured = to_measured(scene, on_plane(position, np.array(scene.source_mm))) + rng.normal(0, 0.05, (60, 2))
    gauge = similarity_near(on_plane(position, START_MM), measured, np.array([511.5, 511.5]), 256.0)
    whole = estimate_jointly(Observations(measured, np.full(60, 0.05), position), START_MM, NOMINAL, gauge)
    residual, _ = whole.solution.left_out()
    keep = np.arange(60) != 17
    part = estimate_jointly(Observations(measured, np.full(60, 0.05), position).select(keep), START_MM, NOMINAL, gauge)
    displacement, _ = part.solution.predict(measured[17:18])
    ideal = gauge.pixels(on_plane(position[17:18], part.source_mm))
    assert residual[17] == pytest.approx((ideal - measured[17] - displacement)[0], abs=0.05)


def test_polynomial_and_kernel_have_the_right_shape_and_value() -> None:
    basis = polynomial(np.array([[10.0, 20.0]]), np.array([0.0, 0.0]), 10.0, 3)
    assert basis.shape == (1, 10)
    assert basis.max() == pytest.approx(8.0)
    falling = correlation(distances_px(np.array([[0.0, 0.0]]), np.array([[0.0, 0.0], [600.0, 800.0]])), 50.0)
    assert falling[0, 0] == pytest.approx(1.0)
    assert falling[0, 1] < 1e-6
    assert Hyperparameters(3, 1.0, 2.0, 1.0).order == 3

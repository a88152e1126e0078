"""Whole images: where things appear, and that the same seed makes the same image."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from simulation.render.image import ImageFaults, Noise, Shot, render_scene
from simulation.render.primary import ray_samples, trace
from simulation.render.scene import balls_in_view, pack_scene
from simulation.room.drilling import drill, drill_force_n, insert_wire
from simulation.scenario.imaging_values import Intensifier
from simulation.scenario.values import Scenario
from simulation.world.poses import WorldState, starting_state, world_at
from tests.kept import kept
from tests.unit.simulation import rooms

QUIET = Noise.NONE


@kept
def shot_of(scenario: Scenario, state: WorldState | None = None, noise: Noise = QUIET) -> Shot:
    return render_scene(scenario, state or starting_state(scenario), noise=noise)


def centroid_errors_px(scenario: Scenario) -> NDArray[np.float64]:
    """Centroid of each ball's shadow minus truth, shape (N, 2), for balls alone over an even background.

    Over an edge of the bone the beam is harder on one side, and the shadow is really lopsided there.
    """
    state = replace(starting_state(scenario), nail_present=False)
    world = world_at(scenario, state)
    balls = balls_in_view(scenario, world)
    packed = pack_scene(scenario, world, balls)
    without = packed._replace(tile_start=np.zeros_like(packed.tile_start))
    with_balls, bare = (trace(scenario, world, p).primary.astype(np.float64) for p in (packed, without))
    rows, columns = np.mgrid[0 : bare.shape[0], 0 : bare.shape[1]]
    errors = []
    for i, (x, y) in enumerate(balls.image_px):
        near = np.hypot(columns - x, rows - y) < balls.radius_px[i] + 3.0
        others = np.linalg.norm(np.delete(balls.image_px, i, axis=0) - [x, y], axis=1)
        if near.sum() < np.pi * balls.radius_px[i] ** 2 or others.min() < 25.0:
            continue
        if np.ptp(bare[near]) > 0.06 * bare[near].mean():
            continue
        weight = 1.0 - with_balls[near] / bare[near]
        errors.append([columns[near] @ weight / weight.sum() - x, rows[near] @ weight / weight.sum() - y])
    return np.array(errors)


def test_balls_appear_where_the_truth_says() -> None:
    errors = centroid_errors_px(rooms.scenario(seed=2, size_px=1024))
    assert len(errors) == 4
    assert np.abs(errors).max() < 0.016  # measured: 0.011


@pytest.mark.long
def test_distortion_moves_balls_as_the_truth_says() -> None:
    bent = Intensifier(280.0, 0.02, 0.8, 0.5, 440.0, 1.0, 0.4, (2.0, -1.5), 480.0, 0.0)
    scenario = replace(rooms.scenario(seed=3, size_px=1024), detector=bent)
    balls = balls_in_view(scenario, world_at(scenario, starting_state(scenario)))
    assert np.linalg.norm(balls.image_px - balls.ideal_px, axis=1).max() > 6.0
    errors = centroid_errors_px(scenario)
    assert len(errors) >= 3
    # The shadow is bent too, so its centroid is not quite the centre's image.
    assert np.abs(errors).max() < 0.03


def test_the_same_seed_makes_the_same_image() -> None:
    first, second = (shot_of(rooms.scenario(), noise=Noise.REAL).pixels for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_another_shot_has_other_noise() -> None:
    scenario = rooms.scenario()
    state = starting_state(scenario)
    first, second = (render_scene(scenario, state, shot_number=n).pixels.astype(float) for n in (1, 2))
    assert 0 < np.abs(first - second).mean() < 0.05 * first.mean()


def test_noise_is_about_one_per_cent_of_the_grey_values() -> None:
    scenario = replace(rooms.scenario(), exposure=replace(rooms.scenario().exposure, photons_per_px=900.0))
    difference = shot_of(scenario, noise=Noise.REAL).pixels.astype(float) - shot_of(scenario).pixels
    middle = difference[110:150, 110:150] / shot_of(scenario).pixels[110:150, 110:150]
    assert 0.003 < np.std(middle) < 0.04


def test_a_mirrored_turned_display_shows_the_truths_pixels() -> None:
    base = replace(rooms.scenario(seed=4, size_px=512), display=replace(rooms.PLAIN_DISPLAY, quarter_turns=3))
    plain, mirrored = shot_of(base), shot_of(replace(base, display=replace(base.display, mirrored=True)))
    np.testing.assert_array_equal(mirrored.pixels, plain.pixels[:, ::-1])
    ball = next(b for b in plain.truth.balls if b.in_view and not b.over_metal and not b.touches_ball)
    column, row = np.rint(ball.image_px).astype(int)
    around = plain.pixels[row - 12 : row + 13, column - 12 : column + 13]
    assert plain.pixels[row, column] < 0.85 * np.median(around)


def test_truths_camera_projects_truths_balls() -> None:
    scenario = replace(rooms.scenario(seed=5), display=replace(rooms.PLAIN_DISPLAY, quarter_turns=1))
    truth = shot_of(scenario).truth
    points = truth.camera_from_ring @ scenario.parts.ring.balls.position_mm
    projected = points @ truth.intrinsic_matrix_px.T
    expected = [b.undistorted_px for b in truth.balls if b.id.startswith("R")]
    np.testing.assert_allclose(projected[:, :2] / projected[:, 2:], expected, atol=1e-9)


def test_without_a_nail_its_place_is_brighter_and_it_is_not_in_the_truth() -> None:
    scenario = rooms.scenario()
    state = starting_state(scenario)
    full, empty = shot_of(scenario), shot_of(scenario, replace(state, nail_present=False))
    assert empty.truth.camera_from_nail is None
    middle = world_at(scenario, state).beam_from_nail @ np.zeros(3)
    column, row = np.rint((full.truth.intrinsic_matrix_px @ middle / middle[2])[:2]).astype(int)
    assert full.pixels[row, column] < 0.5 * empty.pixels[row, column]


def test_without_a_guide_its_balls_are_gone() -> None:
    truth = shot_of(rooms.scenario(), replace(starting_state(rooms.scenario()), guide_present=False)).truth
    assert truth.camera_from_guide is None
    assert all(b.id.startswith("R") for b in truth.balls)


def test_a_wire_darkens_its_line_and_is_in_the_truth() -> None:
    scenario = rooms.scenario()
    state = starting_state(scenario)
    wire = insert_wire(scenario, state, "distal")
    wired = replace(state, wires=(wire.rod,))
    before, after = shot_of(scenario), shot_of(scenario, wired)
    assert np.count_nonzero(after.pixels < 0.9 * before.pixels) > 10
    assert after.truth.wires[0].id == "distal"
    assert after.truth.wires[0].entry_offset_mm == pytest.approx(wire.entry_offset_mm)


def test_a_drilled_hole_brightens_the_bone() -> None:
    scenario = rooms.scenario(size_px=512)
    state = replace(starting_state(scenario), guide_present=False, nail_present=False)
    hole = drill(scenario, state, "proximal", drill_force_n(scenario, 0))
    brighter = (
        shot_of(scenario, replace(state, drilled=(hole.rod,))).pixels.astype(float) - shot_of(scenario, state).pixels
    )
    assert np.count_nonzero(brighter > 500.0) > 50


@pytest.mark.parametrize(
    ("faults", "noisier"), [(ImageFaults(dose_factor=0.05), 2.5), (ImageFaults(dose_factor=0.01), 6.0)]
)
def test_a_low_dose_is_noisy(faults: ImageFaults, noisier: float) -> None:
    scenario = rooms.scenario()
    state = starting_state(scenario)
    quiet = shot_of(scenario).pixels.astype(float)
    usual, faulty = (render_scene(scenario, state, faults=f).pixels - quiet for f in (ImageFaults(), faults))
    assert np.std(faulty[100:150, 100:150]) > noisier * np.std(usual[100:150, 100:150])


def test_opposite_noise_is_that_of_the_same_shot_with_its_sign_changed() -> None:
    scenario = rooms.scenario()
    quiet, real, opposite = (
        shot_of(scenario, noise=noise).pixels.astype(float) for noise in (QUIET, Noise.REAL, Noise.OPPOSITE)
    )
    grey = (quiet > 5000.0) & (quiet < 50000.0)
    apart, sum_of_both = (real - opposite)[grey], (real + opposite - 2.0 * quiet)[grey]
    assert apart.std() > 200.0
    assert sum_of_both.std() < 0.05 * apart.std()


def test_overexposure_saturates() -> None:
    scenario = rooms.scenario()
    bright = render_scene(scenario, starting_state(scenario), faults=ImageFaults(overexposure=8.0)).pixels
    usual = shot_of(scenario).pixels
    assert np.mean(bright == 65535) > np.mean(usual == 65535) + 0.2


def test_samples_of_a_pixel_average_to_its_middle() -> None:
    samples = ray_samples(0.6)
    np.testing.assert_allclose(samples.mean(axis=0), 0.0, atol=1e-12)
    assert np.abs(samples[:, :2]).max() < 0.5
    assert 0.2 < np.abs(samples[:, 2:]).max() < 0.3
    correlation = np.corrcoef(samples.T) - np.eye(4)
    assert np.abs(correlation).max() < 0.2

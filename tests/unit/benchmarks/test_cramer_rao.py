"""The limit against cases whose answer is known without it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.limits.cramer_rao import limits_of, pixel_covariance
from benchmarks.limits.cramer_rao_crop import crop_about_holes, sample_sets
from benchmarks.limits.cramer_rao_images import SceneImages
from benchmarks.scenes.random_scenes import scene_of_seed
from shared.geometry.frames import Nail
from shared.geometry.transform import Transform
from simulation.render.scene import balls_in_view, pack_scene
from simulation.world.poses import starting_state, world_at
from tests.unit.services.registration.xray_scene import nail_part

SIDE = 30
SIDES = (2.6e-3, -2.6e-3)
SCENARIO = scene_of_seed(5003)
SHARP = replace(
    SCENARIO, exposure=replace(SCENARIO.exposure, blur_px=1e-3, tail_px=1e-3, tail_share=0.0, glare_share=0.0)
)


def images(noise: float, texture: float = 0.0) -> SceneImages:
    """A picture on which each of the six motions of the nail acts by a pattern of its own; nothing else is unknown."""
    rng = np.random.default_rng(3)
    derivatives = np.stack([rng.standard_normal((6, SIDE, SIDE))] * 2)
    counted = np.zeros((1, SIDE, SIDE), dtype=bool)
    counted[0, 4:26, 5:25] = True
    even = np.ones((SIDE, SIDE))
    samples = texture * rng.standard_normal((4, SIDE, SIDE))
    return SceneImages(counted, derivatives, np.zeros(6), noise**2 * even, 1e-12 * even, even, samples, 6.0, SHARP)


def test_without_texture_it_is_that_of_least_squares() -> None:
    shown, nail = images(noise=0.5), nail_part()
    columns = shown.derivatives[0][:, shown.counted[0]]
    covariance = np.linalg.inv(columns @ columns.T / 0.25)
    limits = limits_of(shown, nail, smooth_share=0.0)
    expected = np.degrees(np.sqrt(covariance[0, 0] + covariance[1, 1]))
    assert [limit.axis_deg for limit in limits] == pytest.approx([expected] * 2, rel=1e-3)


def test_it_goes_as_the_noise() -> None:
    quiet, loud = (limits_of(images(noise=noise), nail_part(), 0.0)[0] for noise in (0.2, 0.6))
    assert loud.axis_deg == pytest.approx(3.0 * quiet.axis_deg, rel=1e-6)
    assert loud.entry_mm == pytest.approx(3.0 * quiet.entry_mm, rel=1e-6)


def test_texture_and_a_smooth_field_only_take_information_away() -> None:
    plain = limits_of(images(noise=0.3), nail_part(), 0.0)[0]
    textured = limits_of(images(noise=0.3, texture=0.5), nail_part(), 0.0)[0]
    varying = limits_of(images(noise=0.3), nail_part(), 0.5)[0]
    assert textured.axis_deg > 1.2 * plain.axis_deg
    assert varying.axis_deg > plain.axis_deg


def test_the_covariance_is_that_of_the_fields_it_is_made_of() -> None:
    shown = images(noise=0.3, texture=0.5)
    covariance = pixel_covariance(shown, shown.counted[0], 0.2)
    assert covariance == pytest.approx(covariance.T, abs=1e-12)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert np.diag(covariance) == pytest.approx(0.3**2 + 0.5**2 + 0.2**2, rel=0.1)


def test_noise_of_the_derivatives_is_not_taken_for_information() -> None:
    rng, nail, exact = np.random.default_rng(4), nail_part(), images(noise=0.5)
    clear = limits_of(exact, nail, 0.0)[0].axis_deg
    noisy = exact.derivatives + 0.5 * rng.standard_normal(exact.derivatives.shape)
    two, one_twice = (limits_of(replace(exact, derivatives=noisy[which]), nail, 0.0)[0] for which in ([0, 1], [0, 0]))
    assert two.axis_deg == pytest.approx(clear, rel=0.05)
    assert one_twice.axis_deg < 0.93 * clear


def test_two_sets_that_contradict_each_other_are_refused() -> None:
    shown = images(noise=0.5)
    opposite = replace(shown, derivatives=shown.derivatives * np.array([1.0, -1.0])[:, None, None, None])
    with pytest.raises(ValueError, match=r"scene of seed 5003 is -\d.*must be above 0.*trace more \(SAMPLES"):
        limits_of(opposite, nail_part(), 0.0)


def test_few_rays_tell_of_a_turn_what_many_do() -> None:
    """The square of the signal's change, summed over pixels about the holes, is the information under white noise."""
    world = world_at(SCENARIO, starting_state(SCENARIO))
    balls = balls_in_view(SCENARIO, world)
    packed = pack_scene(SCENARIO, world, balls)
    size = (SCENARIO.c_arm.size_px,) * 2
    crop = crop_about_holes(SCENARIO, world, packed, np.ones(size, dtype=np.float32))
    some = np.zeros(crop.near.shape, dtype=bool)
    some[::4, ::4] = crop.near[::4, ::4]
    turned: list[Transform[Nail, Nail]] = [Transform.from_rotvec(angle * np.eye(3)[0], np.zeros(3)) for angle in SIDES]
    sides = [pack_scene(SCENARIO, replace(world, beam_from_nail=world.beam_from_nail @ turn), balls) for turn in turned]
    told = []
    for draw, count in ((0, 128), *((draw, 8) for draw in range(1, 41))):
        traced = replace(crop, near=some, edges=some, samples=sample_sets(SCENARIO.exposure.focal_spot_mm, count, draw))
        one, other = traced.primary(sides[0]) - traced.primary(sides[1])
        told.append((float(np.sum(one * one)), float(np.sum(one * other))))
    (_, by_many), *by_few = told
    one_set_twice, two_sets = np.mean(by_few, axis=0) / by_many
    assert two_sets == pytest.approx(1.0, abs=0.15)
    assert one_set_twice > 1.3

"""What passes metal: the law against the X-rays of a tube, and its derivatives."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from services.registration.core.nail.shade import shade_behind
from simulation.render.attenuation import Material, attenuation_per_mm, spectrum

PATHS_MM = np.concatenate([np.linspace(0.0, 1.0, 30), np.linspace(1.0, 13.0, 60)])
CORTEX_MM = 10.0


def law(paths_mm: NDArray[np.float64], attenuation: float, hardening: float) -> NDArray[np.float64]:
    return np.array([shade_behind(path, (attenuation, hardening))[0] for path in paths_mm])


@pytest.mark.parametrize("metal", [Material.TITANIUM, Material.STEEL])
@pytest.mark.parametrize("kilovolts", [64.0, 76.0])
@pytest.mark.parametrize("muscle_mm", [100.0, 200.0])
def test_the_law_holds_for_the_x_rays_of_a_tube_behind_a_thigh(
    metal: Material, kilovolts: float, muscle_mm: float
) -> None:
    """A quarter of a per cent along a hole's rim already turns a titanium nail by 0.1 degrees."""
    beam = spectrum(kilovolts, 4.0, bins=40)
    muscle = attenuation_per_mm(Material.MUSCLE, beam.energy_kev)
    bone = attenuation_per_mm(Material.CORTICAL_BONE, beam.energy_kev)
    behind = beam.weight * np.exp(-muscle * muscle_mm - bone * CORTEX_MM)
    # the nail takes the place of tissue
    per_mm = attenuation_per_mm(metal, beam.energy_kev) - muscle
    true = np.exp(-np.outer(PATHS_MM, per_mm)) @ behind / behind.sum()
    best, _ = curve_fit(law, PATHS_MM, true, p0=(float(per_mm @ behind / behind.sum()), 0.65))
    assert 0.3 < best[1] < 1.1
    assert np.abs(law(PATHS_MM, *best) - true).max() < 0.0015


@pytest.mark.parametrize("hardening", [0.0, 0.0005, 0.002, 0.3, 1.5])
@pytest.mark.parametrize("path_mm", [0.01, 0.8, 9.0])
def test_derivatives_are_those_of_the_law(hardening: float, path_mm: float) -> None:
    attenuation, step = 0.5, 1e-4
    _, by_depth, by_hardening = shade_behind(path_mm, (attenuation, hardening))
    sides = [shade_behind(path_mm * np.exp(s), (attenuation, hardening))[0] for s in (step, -step)]
    assert by_depth == pytest.approx((sides[0] - sides[1]) / (2.0 * step), rel=1e-5)
    above, here = (shade_behind(path_mm, (attenuation, max(hardening, 0.001) + h))[0] for h in (0.01, 0.0))
    assert by_hardening == pytest.approx((above - here) / 0.01, rel=0.05)


def test_nothing_is_lost_without_metal_and_nothing_passes_much() -> None:
    assert shade_behind(0.0, (1.6, 0.65)) == (1.0, 0.0, 0.0)
    assert shade_behind(200.0, (1.6, 0.65))[0] < 1e-30

"""Attenuation against published figures."""

import numpy as np
import pytest

from simulation.render.attenuation import Material, attenuation_per_mm, spectrum

# 1/cm at 50, 60, 80 keV: muscle, cortical bone, Delrin, PMMA, Ti-6Al-4V, steel 316L.
PUBLISHED = {
    Material.MUSCLE: (0.238, 0.215, 0.191),
    Material.CORTICAL_BONE: (0.815, 0.604, 0.428),
    Material.DELRIN: (0.300, 0.275, 0.248),
    Material.PMMA: (0.245, 0.227, 0.207),
    Material.TITANIUM: (5.18, 3.28, 1.75),
    Material.STEEL: (16.5, 10.1, 4.98),
}


@pytest.mark.parametrize("material", list(PUBLISHED))
def test_attenuation_is_the_published(material: Material) -> None:
    found = 10.0 * attenuation_per_mm(material, np.array([50.0, 60.0, 80.0]))
    np.testing.assert_allclose(found, PUBLISHED[material], rtol=0.012)


def test_air_attenuates_nothing() -> None:
    assert attenuation_per_mm(Material.AIR, np.array([50.0])) == 0.0


@pytest.mark.parametrize(("voltage_kv", "bins"), [(60.0, 6), (70.0, 6), (80.0, 6), (70.0, 24)])
def test_effective_energy_behind_a_thigh_is_40_to_48_kev(voltage_kv: float, bins: int) -> None:
    beam = spectrum(voltage_kv, 3.5, bins)
    behind = beam.weight * np.exp(-140.0 * beam.attenuation_per_mm[Material.MUSCLE])
    # The energy of a pure beam that the thigh would attenuate by the same factor.
    effective_per_mm = -np.log(behind.sum()) / 140.0
    energies = np.linspace(30.0, 60.0, 3001)
    effective_kev = energies[np.argmin(np.abs(attenuation_per_mm(Material.MUSCLE, energies) - effective_per_mm))]
    assert 39.5 < effective_kev < 48.0


@pytest.mark.parametrize(
    ("material", "thickness_mm", "share"),
    [(Material.STEEL, 2.0, 0.055), (Material.STEEL, 3.0, 0.018), (Material.TITANIUM, 10.0, 0.014)],
)
def test_metal_lets_a_few_per_cent_through_at_70_kv(material: Material, thickness_mm: float, share: float) -> None:
    beam = spectrum(70.0, 4.0)
    behind = beam.weight * np.exp(-140.0 * beam.attenuation_per_mm[Material.MUSCLE])
    through = behind @ np.exp(-thickness_mm * beam.attenuation_per_mm[material]) / behind.sum()
    assert through == pytest.approx(share, rel=0.08)


def test_weights_are_shares() -> None:
    assert spectrum(70.0, 3.5).weight.sum() == pytest.approx(1.0)

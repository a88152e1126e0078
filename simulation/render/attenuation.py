"""Linear attenuation of the materials, and the X-ray spectrum in a few energy bins.

Coefficients are NIST's (XCOM) mass attenuation coefficients times density; alloys by mass fraction (316L steel: Fe
68.5, Cr 17, Ni 12, Mo 2.5 %; Ti-6Al-4V; polyoxymethylene for Delrin).
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from shared.geometry.lines import read_only


class Material(IntEnum):
    """What a ray can pass through. Rows of every attenuation table; air attenuates nothing."""

    AIR = 0
    MUSCLE = 1
    CORTICAL_BONE = 2
    DELRIN = 3
    PMMA = 4
    TITANIUM = 5
    STEEL = 6


_ENERGY_KEV = np.array([20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0])
_PER_CM = {
    Material.MUSCLE: [0.863, 0.397, 0.282, 0.2375, 0.2150, 0.1914, 0.1776],
    Material.CORTICAL_BONE: [7.681, 2.556, 1.278, 0.8145, 0.6044, 0.4280, 0.3560],
    Material.DELRIN: [0.997, 0.467, 0.348, 0.3006, 0.2750, 0.2480, 0.2300],
    Material.PMMA: [0.680, 0.361, 0.280, 0.2468, 0.2290, 0.2084, 0.1950],
    Material.TITANIUM: [67.2, 21.1, 9.42, 5.18, 3.28, 1.75, 1.17],
    Material.STEEL: [212.0, 69.1, 30.8, 16.5, 10.1, 4.98, 3.10],
}
_ALUMINIUM_PER_CM = np.array([9.29, 3.046, 1.535, 0.994, 0.750, 0.545, 0.460])
# Share of quanta that 0.4 mm of caesium iodide absorbs, rounded; its K edges lie at 33 and 36 keV.
_PHOSPHOR_KEV = np.array([20.0, 30.0, 33.0, 36.0, 40.0, 50.0, 60.0, 80.0, 100.0])
_PHOSPHOR_ABSORBS = np.array([0.99, 0.80, 0.72, 0.98, 0.98, 0.90, 0.76, 0.48, 0.31])
_LEAST_ENERGY_KEV = 24.0


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Detected spectrum in bins.

    Attributes
    ----------
    energy_kev
        Middle of each bin, shape (E,).
    weight
        Share of each bin in the detected signal of the open beam, shape (E,), sum 1.
    attenuation_per_mm
        Linear attenuation, shape (materials, E).
    """

    energy_kev: NDArray[np.float64]
    weight: NDArray[np.float64]
    attenuation_per_mm: NDArray[np.float64]


def _at(energy_kev: NDArray[np.float64], table: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.exp(np.interp(np.log(energy_kev), np.log(_ENERGY_KEV), np.log(table))))


def attenuation_per_mm(material: Material, energy_kev: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear attenuation at energies, shape (E,), by log-log interpolation."""
    if material is Material.AIR:
        return np.zeros_like(energy_kev)
    return _at(energy_kev, np.array(_PER_CM[material])) / 10.0


def spectrum(tube_voltage_kv: float, filtration_mm_aluminium: float, bins: int = 6) -> Spectrum:
    """Kramers' bremsstrahlung behind an aluminium filter, as a caesium iodide phosphor weighs it.

    Parameters
    ----------
    tube_voltage_kv
        Peak voltage, 50-100.
    filtration_mm_aluminium
        Total filtration.
    bins
        Number of energy bins of equal width.
    """
    edges = np.linspace(_LEAST_ENERGY_KEV, tube_voltage_kv, bins + 1)
    energy = 0.5 * (edges[1:] + edges[:-1])
    # Kramers: photons per keV ~ (E0 - E) / E; times E for the energy each deposits in the phosphor.
    photons = (tube_voltage_kv - energy) / energy
    filtered = photons * np.exp(-_at(energy, _ALUMINIUM_PER_CM) * filtration_mm_aluminium / 10.0)
    signal = filtered * energy * np.interp(energy, _PHOSPHOR_KEV, _PHOSPHOR_ABSORBS)
    table = np.stack([attenuation_per_mm(m, energy) for m in Material])
    return Spectrum(read_only(energy), read_only(signal / signal.sum()), read_only(table))

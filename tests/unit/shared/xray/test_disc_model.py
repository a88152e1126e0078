"""The blurred edge that discs are drawn with."""

import numpy as np
from scipy.special import erfc

from shared.xray.disc_model import bell_of, edge

OUTSIDE = np.linspace(-14.0, 14.0, 2801)


def test_the_bell_is_a_gaussian() -> None:
    bells = np.array([bell_of(z) for z in OUTSIDE])
    assert np.abs(bells - np.exp(-0.5 * OUTSIDE**2)).max() < 1e-12


def test_the_edge_is_a_blurred_step() -> None:
    edges = np.array([edge(z, bell_of(z)) for z in OUTSIDE])
    assert np.abs(edges - 0.5 * erfc(OUTSIDE / np.sqrt(2.0))).max() < 2e-7

"""Which pixels take part in the nail's fit."""

from dataclasses import replace

import numpy as np
import pytest

from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.window import Scale, Window, cut_window
from tests.unit.services.registration.rendered_case import CAMERA_FROM_NAIL, Shown, rendered, rendered_parts


def window_with(hidden: tuple[slice, slice] | None, reduction: int) -> Window:
    parts, (pixels, view) = rendered_parts(), rendered(Shown(), seed=3)
    occluders = Occluders(None, parts.ring)
    if hidden is not None:
        mask = np.zeros(pixels.shape, dtype=bool)
        mask[hidden] = True
        occluders = replace(occluders, hidden=mask)
    window = cut_window(pixels, view, parts.nail, 3.5, CAMERA_FROM_NAIL, occluders, Scale(reduction, 0.0))
    assert window is not None
    return window


@pytest.mark.parametrize("reduction", [1, 3])
def test_hidden_pixels_are_not_compared_and_all_others_are(reduction: int) -> None:
    whole = window_with(None, reduction)
    middle = whole.compared[len(whole.compared) // 2]
    row, column = (int(v) for v in np.unravel_index(middle, whole.shape))
    x, y = (round(o + reduction * at) for o, at in zip(whole.origin_px, (column, row), strict=True))
    hidden = (slice(y - 10, y + 11), slice(x - 10, x + 11))
    left_out = set(whole.compared) - set(window_with(hidden, reduction).compared)
    assert middle in left_out
    rows, columns = np.unravel_index(sorted(left_out), whole.shape)
    assert len(left_out) >= 0.9 * (21 // reduction) ** 2  # the strip may end nearby
    assert np.ptp(rows) <= 20 // reduction + 1
    assert np.ptp(columns) <= 20 // reduction + 1

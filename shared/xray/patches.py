"""Cut the pixels around groups of discs out of an image, padded to equal length."""

import numpy as np
from numpy.typing import NDArray

from shared.xray.discs import Array, Patches


def patches_around(pixels: NDArray[np.float32], centre_px: Array, reach_px: Array) -> Patches:
    """Pixels within reach of any disc of each group.

    Parameters
    ----------
    pixels
        Image, shape (rows, columns).
    centre_px
        Discs' centres, shape (G, K, 2).
    reach_px
        Radius of the region around each disc, shape (G, K).

    Returns
    -------
    Patches
        Pixels beyond the image's border have weight zero.
    """
    low = np.floor((centre_px - reach_px[:, :, None]).min(axis=1)).astype(np.int64)
    high = np.ceil((centre_px + reach_px[:, :, None]).max(axis=1)).astype(np.int64)
    width, height = (high - low).max(axis=0) + 1
    x = low[:, 0, None, None] + np.arange(width)[None, None, :] + np.zeros((1, height, 1), np.int64)
    y = low[:, 1, None, None] + np.arange(height)[None, :, None] + np.zeros((1, 1, width), np.int64)
    rows, columns = pixels.shape
    inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    near = np.zeros(x.shape, dtype=bool)
    for k in range(centre_px.shape[1]):
        dx = x - centre_px[:, k, 0, None, None]
        dy = y - centre_px[:, k, 1, None, None]
        near |= dx**2 + dy**2 <= reach_px[:, k, None, None] ** 2
    grey = pixels[np.clip(y, 0, rows - 1), np.clip(x, 0, columns - 1)].astype(np.float64)
    groups = len(centre_px)
    return Patches(
        x.reshape(groups, -1).astype(np.float64),
        y.reshape(groups, -1).astype(np.float64),
        grey.reshape(groups, -1),
        (inside & near).reshape(groups, -1).astype(np.float64),
    )

"""What a screen looks like from some distance: for comparing it with how it looked before.

Letters, numbers and ages are blurred away; a panel that is missing, empty, in another place or over another is not.
"""

import io
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page

_SMALL_PX: Final = (160, 100)
_BLOCK_PX: Final = 10
# Chosen: other fonts and other ages give up to 20 of 255 in a block, a panel that is missing 40 and more.
LARGEST_DIFFERENCE: Final = 30.0

Look = NDArray[np.uint8]


def look_of(page: Page) -> Look:
    """The page now with nothing scrolled, shape (100, 160)."""
    page.evaluate("document.querySelectorAll('main *').forEach((one) => { one.scrollTop = 0; })")
    return _small(page.screenshot(animations="disabled"))


def _small(png: bytes) -> Look:
    with Image.open(io.BytesIO(png)) as picture:
        return np.asarray(picture.convert("L").resize(_SMALL_PX, Image.Resampling.BOX), dtype=np.uint8)


def difference(one: Look, other: Look) -> float:
    """Mean difference of grey values in the block, 1/16 of the width across, where it is largest."""
    apart = np.abs(one.astype(np.float64) - other.astype(np.float64))
    height, width = apart.shape
    blocks = apart.reshape(height // _BLOCK_PX, _BLOCK_PX, width // _BLOCK_PX, _BLOCK_PX)
    return float(blocks.mean(axis=(1, 3)).max())


def keep(look: Look, file: Path) -> None:
    """As a small PNG."""
    Image.fromarray(look).save(file, optimize=True)


def kept(file: Path) -> Look:
    """What `keep` wrote."""
    with Image.open(file) as picture:
        return np.asarray(picture, dtype=np.uint8)

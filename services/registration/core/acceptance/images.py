"""Acceptance of several images of one set-up: how far they may disagree."""

from typing import Final

from scipy.special import chdtri

from shared.acceptance import Criterion, at_most
from shared.errors import ReasonCode

# One good set in ten thousand would be refused if predicted standard deviations were exact; they may be too small by a
# quarter, which is what single images are held to.
_SURVIVAL: Final = 1e-4
_EXCESS: Final = 1.25**2


def chi_square_limit(degrees_of_freedom: int) -> float:
    """Largest chi-square with which images agree."""
    return _EXCESS * float(chdtri(degrees_of_freedom, _SURVIVAL))


IMAGES_CHI_SQUARE: Final = Criterion(
    code=ReasonCode.IMAGES_DISAGREE,
    measured="chi-square of the images' poses and hole shapes about their joint estimate",
    limit=at_most(round(chi_square_limit(9), 1), "", decimals=0),
    depends="rises with the number of images: nine degrees of freedom for each after the first; the value is that of "
    "two images",
    remedy="check that mount and guide are tight, leave out the image that the sentence names, or take one more image",
    origin="derived: exceeded by one set of images in 10,000 if standard deviations are 1.25 times the predicted ones",
)
OUTLINE_CHI_SQUARE: Final = Criterion(
    code=ReasonCode.IMAGES_DISAGREE,
    measured="chi-square of the nail's outline in an oblique image about the place that guide and holes predict",
    limit=at_most(round(chi_square_limit(2), 1), "", decimals=0),
    remedy="check that mount and guide are tight, and take all images again",
    origin=IMAGES_CHI_SQUARE.origin,
)

"""The one reader of image folders with a manifest: the independent images, and scenes of `same_results`.

A folder holds `manifest.json`, images, part files and, for the independent images, one file of truth each. An entry of
the manifest may name its own ring and guide; without, those of the manifest apply.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from benchmarks.common.places import INDEPENDENT_IMAGES

MANIFEST = "manifest.json"
Expected = Literal["accept", "reject", "either"]
Matrix = list[list[float]]


class _File(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class NominalEntry(_File):
    """Nominal values of the C-arm."""

    source_to_detector_mm: float = 1000.0
    pixel_mm: float = 0.235


class Display(_File):
    """How the display shows the rendered image: mirrored first, then turned by quarters."""

    flip: bool = False
    rot90: int = 0


class Entry(_File):
    """One image of a manifest; the names of files are relative to its folder."""

    image: str
    nail: str
    ring: str | None = None
    guide: str | None = None
    truth: str | None = None
    nominal: NominalEntry = NominalEntry()
    tilt_deg: float = 0.0
    flat_panel: bool = False
    display: Display = Display()
    expect: Expected = "either"


class _Manifest(_File):
    ring: str | None = None
    guide: str | None = None
    images: tuple[Entry, ...] = Field(min_length=1)


class HoleTruth(_File):
    """A hole as it is: in mm, in the guide's frame."""

    id: str
    entry_point_guide_mm: tuple[float, float, float]
    axis_guide: tuple[float, float, float]


class BallTruth(_File):
    """A ball of the ring ("R...") or of the guide as it appears in the rendered image, in pixels."""

    id: str
    image_px: tuple[float, float]
    undistorted_px: tuple[float, float]


class Truth(_File):
    """What is true of an image; matrices are rounded to six digits (see `nearest_pose`)."""

    intrinsic_matrix_px: Matrix
    camera_from_ring: Matrix
    camera_from_guide: Matrix | None
    camera_from_nail: Matrix | None
    holes: tuple[HoleTruth, ...]
    balls: tuple[BallTruth, ...]


@dataclass(frozen=True, slots=True)
class ListedImage:
    """One image of a folder.

    Attributes
    ----------
    ring, guide, nail
        Paths of its part files.
    """

    folder: Path
    entry: Entry
    ring: Path
    guide: Path
    nail: Path

    @property
    def name(self) -> str:
        """As the manifest lists it."""
        return self.entry.image

    @property
    def path(self) -> Path:
        """File of the image."""
        return self.folder / self.entry.image

    def truth(self) -> Truth:
        """What is true of it.

        Raises
        ------
        ValueError
            When the manifest names no truth.
        """
        if self.entry.truth is None:
            raise ValueError(f"the manifest of {self.folder} names no truth for {self.name}")
        return Truth.model_validate_json((self.folder / self.entry.truth).read_bytes())


def independent_folder() -> Path | None:
    """The folder that DISTALOCK_FLUOROSCOPY names, or ../shared/fluoroscopy; None when no manifest is there."""
    folder = Path(os.environ.get("DISTALOCK_FLUOROSCOPY", INDEPENDENT_IMAGES))
    return folder if (folder / MANIFEST).is_file() else None


def listed_images(folder: Path, names: Sequence[str] = ()) -> tuple[ListedImage, ...]:
    """Images of a folder, in the order of its manifest; with `names`, only those.

    Raises
    ------
    ValueError
        When the manifest is not one, or an image has no ring or guide.
    """
    manifest = _Manifest.model_validate_json((folder / MANIFEST).read_bytes())
    entries = [entry for entry in manifest.images if not names or entry.image in names]
    return tuple(_listed(folder, manifest, entry) for entry in entries)


def _listed(folder: Path, manifest: _Manifest, entry: Entry) -> ListedImage:
    ring, guide = entry.ring or manifest.ring, entry.guide or manifest.guide
    if ring is None or guide is None:
        raise ValueError(f"neither the manifest of {folder} nor its entry {entry.image} names ring and guide")
    return ListedImage(folder, entry, folder / ring, folder / guide, folder / entry.nail)


def nearest_pose(matrix: Matrix) -> NDArray[np.float64]:
    """The nearest rigid pose to a rounded one, shape (4, 4)."""
    pose = np.array(matrix, dtype=np.float64)
    left, _, right = np.linalg.svd(pose[:3, :3])
    pose[:3, :3] = left @ right
    return pose

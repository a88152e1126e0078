"""Folders of images with a manifest, as the independent images and scenes on file have it."""

import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from benchmarks.data.independent_images import independent_folder, listed_images, nearest_pose

SHARED = {"image": "a.png", "nail": "nail.json", "truth": "a.json"}
OWN = {"image": "7/image.png", "ring": "7/ring.json", "guide": "7/guide.json", "nail": "7/nail.json"}


def folder_with(folder: Path, manifest: object) -> Path:
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def test_images_share_the_parts_of_the_manifest_or_bring_their_own(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, {"ring": "ring.json", "guide": "guide.json", "images": [SHARED, OWN]})
    shared, own = listed_images(folder)
    assert (shared.ring, shared.guide) == (folder / "ring.json", folder / "guide.json")
    assert (own.ring, own.guide, own.nail) == tuple(folder / "7" / f"{kind}.json" for kind in ("ring", "guide", "nail"))
    assert own.path == folder / "7" / "image.png"
    assert own.entry.nominal.pixel_mm == 0.235
    assert [image.name for image in listed_images(folder, ["7/image.png"])] == ["7/image.png"]


def test_an_image_without_a_ring_is_refused(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, {"images": [OWN, SHARED]})
    with pytest.raises(ValueError, match=r"entry a\.png names ring and guide"):
        listed_images(folder)


def test_a_manifest_without_images_is_none(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="images"):
        listed_images(folder_with(tmp_path, {"images": []}))


def test_an_image_without_truth_has_none_to_read(tmp_path: Path) -> None:
    (image,) = listed_images(folder_with(tmp_path, {"images": [OWN]}))
    with pytest.raises(ValueError, match="names no truth for 7/image"):
        image.truth()


def test_the_folder_is_the_one_that_the_environment_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISTALOCK_FLUOROSCOPY", str(tmp_path))
    assert independent_folder() is None
    assert independent_folder() or folder_with(tmp_path, {"images": [OWN]}) == independent_folder()


def test_a_rounded_pose_becomes_rigid() -> None:
    rounded = np.eye(4)
    rounded[:3, :3] += 1e-4 * np.arange(9.0).reshape(3, 3)
    rounded[:3, 3] = 1.0, 2.0, 3.0
    pose = nearest_pose(rounded.tolist())
    assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert pose[:3, 3].tolist() == [1.0, 2.0, 3.0]

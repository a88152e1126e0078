"""From observations of the guide in single images to views that can be compared. Pure.

The C-arm stands still during a calibration, so its focal spot is in the same place of the ring's frame in every image.
A single image determines that place to some tenths of a millimetre along the beam, and the guide's distance follows it:
all images together determine it better.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distalock.guide_calibration.hand_eye import GuideView
from distalock.guide_calibration.noise import tilt_beyond_the_fit
from shared.geometry.frames import Guide, Ring
from shared.geometry.hexapod import PlatformPose
from shared.geometry.lines import read_only
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class GuideObservation:
    """One image of the guide and the ring.

    Attributes
    ----------
    pose
        Pose that the controller reported.
    covariance
        Of the fit to the guide's balls alone, shape (6, 6): a small rotation (rad) and translation (mm) in the guide's
        own frame.
    source_ring_mm, source_covariance_mm2
        Focal spot in the ring's frame and its covariance, shapes (3,) and (3, 3).
    """

    pose: PlatformPose
    ring_from_guide: Transform[Ring, Guide]
    covariance: NDArray[np.float64]
    source_ring_mm: NDArray[np.float64]
    source_covariance_mm2: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("covariance", "source_ring_mm", "source_covariance_mm2"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def views_of_one_c_arm(observations: Sequence[GuideObservation]) -> tuple[GuideView, ...]:
    """Views of the guide with one focal spot for all images; empty for none."""
    if not observations:
        return ()
    information = np.linalg.inv([s.source_covariance_mm2 for s in observations])
    covariance_mm2 = np.linalg.inv(information.sum(axis=0))
    sources_mm = np.array([s.source_ring_mm for s in observations])
    source_mm = covariance_mm2 @ np.einsum("nij,nj->i", information, sources_mm)
    return tuple(_view(observation, source_mm, covariance_mm2) for observation in observations)


def _view(
    observation: GuideObservation, source_mm: NDArray[np.float64], source_covariance_mm2: NDArray[np.float64]
) -> GuideView:
    """A shadow on the ring stays when the focal spot moves: what threw it moves by its share of the way to there."""
    seen = observation.ring_from_guide
    share = float(seen.translation_mm[2] / observation.source_ring_mm[2])
    shift_mm = share * (source_mm - observation.source_ring_mm)
    moved: Transform[Ring, Guide] = Transform.from_rotation_translation(seen.rotation, seen.translation_mm + shift_mm)
    covariance = observation.covariance + tilt_beyond_the_fit(seen.rotation)
    covariance[3:, 3:] += share**2 * seen.rotation.T @ source_covariance_mm2 @ seen.rotation
    return GuideView(observation.pose, moved.matrix, covariance)

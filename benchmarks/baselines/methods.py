"""The methods that are compared, each from pixels to hole axes on one image: ours, the paper's, and the paper's rule.

`paper` is the paper's chain whole. `paper's rule` takes the project's calibration, guide and search for the nail, and
only its axis, "the camera's when the holes look round", is the paper's: it tells what that rule alone costs.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.fronto_parallel.axis_rule import SeenNail, along_the_beam
from baselines.fronto_parallel.calibration import calibrate_by_plates
from baselines.fronto_parallel.localise import localise_fronto_parallel
from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.registration.core.guide_from_nail import NailEstimate
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.localise import LocalisationResult, Parts, conclude, localise, unmirrored
from services.registration.core.nail.search.find import find_nail
from shared.errors import Accepted, Reason, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.lines import Line, angle_between_rad

LARGEST_ENTRY_ERROR_MM, LARGEST_AXIS_ERROR_DEG = 1.0, 1.5
_PEER_ROUNDS = 3
T = TypeVar("T")


class Compared(StrEnum):
    """What is compared."""

    MODEL = "model"
    PAPER = "paper"
    PAPER_RULE = "paper's rule"


class TrueHole(Protocol):
    """What is true of a hole."""

    @property
    def id(self) -> str:
        """Name."""

    @property
    def entry_point_guide_mm(self) -> NDArray[np.float64]:
        """Where its axis meets the nail's surface, shape (3,)."""

    @property
    def axis_guide(self) -> NDArray[np.float64]:
        """Its direction, unit, shape (3,)."""


@dataclass(frozen=True, slots=True)
class HoleError:
    """Errors of one hole, and what was predicted as their rms (None where nothing is)."""

    entry_mm: float
    axis_deg: float
    entry_sd_mm: float | None
    axis_sd_deg: float | None


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a method made of an image.

    Attributes
    ----------
    codes
        Why it refused; for methods that never predict their error, `uncertainty_too_large` is left out.
    holes
        Errors of the axes that it found, also when it then refused; None where it found none.
    seconds
        Of wall-clock, from pixels to axes.
    """

    codes: tuple[str, ...]
    holes: tuple[HoleError, ...] | None
    seconds: float

    @property
    def accepted(self) -> bool:
        """Whether it offers axes."""
        return not self.codes

    @property
    def entry_mm(self) -> float | None:
        """The worse hole's."""
        return None if self.holes is None else max(h.entry_mm for h in self.holes)

    @property
    def axis_deg(self) -> float | None:
        """The worse hole's."""
        return None if self.holes is None else max(h.axis_deg for h in self.holes)

    @property
    def off(self) -> bool:
        """Whether axes were found and one is off by more than it may be."""
        entry, axis = self.entry_mm, self.axis_deg
        if entry is None or axis is None:
            return False
        return not (entry <= LARGEST_ENTRY_ERROR_MM and axis <= LARGEST_AXIS_ERROR_DEG)


@dataclass(frozen=True, slots=True, eq=False)
class ModelRun:
    """Our own method with all that came of it: `calibration` and `result` are None when the ring was not found."""

    outcome: Outcome
    calibration: CArmCalibration | None
    result: LocalisationResult | None


def run_model(
    pixels: NDArray[np.float32], nominal: NominalGeometry, parts: Parts, truths: Sequence[TrueHole]
) -> ModelRun:
    """Calibrate and localise by our own method."""
    started = time.perf_counter()
    calibrated = calibrate_image(pixels, parts.ring, nominal)
    if isinstance(calibrated, Rejected):
        return ModelRun(Outcome(codes_of(calibrated.reasons), None, time.perf_counter() - started), None, None)
    result = localise(pixels, calibrated.value, parts)
    seconds = time.perf_counter() - started
    return ModelRun(Outcome(codes_of(result.reasons), hole_errors(result, truths), seconds), calibrated.value, result)


def run_paper(pixels: NDArray[np.float32], named: CArmCalibration, parts: Parts, truths: Sequence[TrueHole]) -> Outcome:
    """The paper's chain; the time that naming the ring's balls takes is not counted."""
    started = time.perf_counter()
    calibrated = calibrate_by_plates(pixels, named, parts.ring)
    if isinstance(calibrated, Rejected):
        return Outcome(codes_of(calibrated.reasons), None, time.perf_counter() - started)
    result = localise_fronto_parallel(pixels, calibrated.value, parts)
    return _of_rule(result, truths, time.perf_counter() - started)


def run_paper_rule(
    pixels: NDArray[np.float32], run: ModelRun, parts: Parts, truths: Sequence[TrueHole]
) -> Outcome | None:
    """The paper's axis rule on what our own search saw; None where our own guide or ring is missing."""
    if run.calibration is None or run.result is None or run.result.guide is None:
        return None
    started = time.perf_counter()
    guide = run.result.guide
    distal = guide.camera_from_guide.directions(np.array([1.0, 0.0, 0.0]))
    start = find_nail(unmirrored(pixels, run.calibration), run.calibration, parts.nail, distal)
    if isinstance(start, Rejected):
        return Outcome(codes_of(start.reasons), None, time.perf_counter() - started)
    found = along_the_beam(SeenNail.of_start(start.value), run.calibration, parts.nail)
    if isinstance(found, Rejected):
        return Outcome(codes_of(found.reasons), None, time.perf_counter() - started)
    nail = Accepted(NailEstimate(found.value.camera_from_nail, None, None))
    result = conclude(run.calibration, parts, Accepted(guide), nail)
    return _of_rule(result, truths, time.perf_counter() - started)


def _of_rule(result: LocalisationResult, truths: Sequence[TrueHole], seconds: float) -> Outcome:
    """The rule predicts no error, and is always refused for that: what counts here is what it would have offered."""
    codes = tuple(code for code in codes_of(result.reasons) if code != "uncertainty_too_large")
    return Outcome(codes, hole_errors(result, truths), seconds)


def codes_of(reasons: Sequence[Reason]) -> tuple[str, ...]:
    """Codes without repetition, in order."""
    return tuple(dict.fromkeys(reason.code.value for reason in reasons))


def hole_errors(result: LocalisationResult, truths: Sequence[TrueHole]) -> tuple[HoleError, ...] | None:
    """Errors hole by hole; None when the method found no axes."""
    if result.holes is None:
        return None
    found = {hole.id: hole for hole in result.holes}
    return tuple(_hole_error(found[truth.id], truth) for truth in truths)


def _hole_error(hole: HoleEstimate, truth: TrueHole) -> HoleError:
    entry_mm = Line(truth.entry_point_guide_mm, truth.axis_guide).distance_mm(hole.entry_guide_mm)
    axis_deg = float(np.degrees(angle_between_rad(truth.axis_guide, hole.axis_guide.direction)))
    offset = hole.offset
    if offset is None:
        return HoleError(entry_mm, axis_deg, None, None)
    return HoleError(entry_mm, axis_deg, offset.entry_sd_mm, offset.axis_sd_deg)


def peer_seconds(pixels: NDArray[np.float32]) -> float:
    """Time of the peer on the same image: OpenCV's search for circles of a ball's size, the best of three."""
    white = max(float(pixels.max()), 1e-9)
    grey = np.asarray(255.0 * pixels / white, dtype=np.uint8)

    def circles() -> object:
        return cv2.HoughCircles(grey, cv2.HOUGH_GRADIENT, 1.0, 8.0, param1=60.0, param2=8.0, minRadius=3, maxRadius=10)

    return min(_timed(circles)[1] for _ in range(_PEER_ROUNDS))


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    started = time.perf_counter()
    value = work()
    return value, time.perf_counter() - started

"""Alignment guidance while fluoroscopy runs: `python -m benchmarks.accuracy.guidance [SCENES]`.

Random scenes (as in the accuracy benchmark: other ring, guide, nail, dose and display each time) are filmed: the C-arm
turns and shifts, rests, and goes on. Each frame is calibrated after the one before it, as imaging does, and followed
after a first frame that is localised in full. Some frames are localised in full as well, for comparison on the same
image. Then the run is disturbed: the leg moves during an exposure, an instrument lies over a hole, the nail is not
there, the view jumps. Tilts are compared with the truth about the image's x and y axes, at every hole; an answer is
wrong when it is off by more than three of its own standard deviations and by more than half a degree. Times are those
of one frame at a time, which may use a second core.
"""

import sys
import time
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.common.places import PAGES
from benchmarks.scenes.fluoroscopy_films import Camera, Frame, Pose, path_of, with_instrument
from benchmarks.scenes.random_scenes import nominal_of, parts_of, scene_of_seed
from services.imaging.core.ring_tracking import calibrate_next
from services.registration.core.c_arm_advice import Advice, hole_tilts
from services.registration.core.guidance.tracking import (
    FrameEstimate,
    Track,
    begin_track,
    track_frame,
)
from services.registration.core.localise import localise
from shared.errors import Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import NailPart
from simulation.render.image import ImageFaults
from simulation.render.truth import ImageTruth
from simulation.scenario.values import Scenario
from simulation.world.poses import starting_state

SCENES, FRAMES, FULL_EVERY = 8, 15, 5
WRONG_DEVIATIONS, WRONG_DEG = 3.0, 0.5
REPORT = PAGES / "guidance.md"
_BLUR_PX = 14.0
_JUMP_DEG, _JUMP_MM = 3.0, 30.0


@dataclass(slots=True)
class Tally:
    """What was measured over all scenes."""

    follow_s: list[float] = field(default_factory=list)
    full_s: list[float] = field(default_factory=list)
    calibrate_s: list[float] = field(default_factory=list)
    followed_deg: list[float] = field(default_factory=list)
    full_deg: list[float] = field(default_factory=list)
    normalised: list[float] = field(default_factory=list)
    full_normalised: list[float] = field(default_factory=list)
    wrong: int = 0
    answered: int = 0
    silent: dict[str, int] = field(default_factory=dict)
    good_frames: int = 0
    not_begun: int = 0
    events: dict[str, list[str]] = field(default_factory=dict)


def errors_of(
    told: Advice, truth: ImageTruth, calibration: CArmCalibration, nail: NailPart
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Errors of the tilts about x and y in degrees, and over their standard deviations, shape (H, 2) each.

    The true camera's frame is turned to that of the calibration by the ring: an image intensifier turns its picture a
    little, and nobody can tell that from a turned camera.
    """
    assert truth.camera_from_nail is not None
    seen_from_true = calibration.camera_from_ring.rotation @ truth.camera_from_ring.rotation.T
    true = np.array([(t.about_x_deg, t.about_y_deg, 0.0) for t in hole_tilts(truth.camera_from_nail, nail)])
    off = np.array([(t.about_x_deg, t.about_y_deg) for t in told.tilts]) - (true @ seen_from_true.T)[:, :2]
    return off, off / np.array([told.about_x_sd_deg, told.about_y_sd_deg])


def film_scene(seed: int, tally: Tally) -> None:
    """Follow one scene from its first frame to the disturbances at its end."""
    scenario = scene_of_seed(seed)
    scene, camera = _Follower(scenario, tally), Camera(scenario)
    for number, pose in enumerate(path_of(starting_state(scenario), seed, FRAMES)):
        tally.good_frames += 1
        if not scene.smooth(camera.frame(pose), number):
            tally.not_begun += 1
            return
    scene.disturbances(camera, pose)


class _Follower:
    """One scene on its way."""

    def __init__(self, scenario: Scenario, tally: Tally) -> None:
        self._scenario, self._tally = scenario, tally
        self._parts, self._nominal = parts_of(scenario), nominal_of(scenario)
        self._before: CArmCalibration | None = None
        self._track: Track | None = None

    def smooth(self, frame: Frame, number: int) -> bool:
        """A frame of the undisturbed run; False when guidance cannot begin in this scene."""
        calibration = self._calibrated(frame)
        if calibration is None:
            self._silent("not calibrated")
            return True
        if self._track is None or number % FULL_EVERY == 0:
            full, track = self._localised(frame, calibration)
            if full.advice is not None:
                self._tally.full_deg.append(self._off(full.advice, frame, calibration)[0])
                self._tally.full_normalised.extend(self._off(full.advice, frame, calibration)[1])
            if self._track is None:
                self._track = track
                return track is not None
        began = time.process_time()
        sight = self._followed(frame, calibration)
        self._tally.follow_s.append(time.process_time() - began)
        if sight.advice is None:
            self._silent(sight.reasons[0].code.value)
            return True
        self._count(sight.advice, frame, calibration)
        return True

    def disturbances(self, camera: Camera, pose: Pose) -> None:
        """Motion blur, a covered hole, no nail, a jump; undisturbed frames between them."""
        still = camera.frame(pose)
        calibration = self._calibrated(still)
        if calibration is None:
            return
        blurred = camera.frame(pose, faults=ImageFaults(motion_blur_px=_BLUR_PX))
        covered = with_instrument(still, self._parts.nail, calibration)
        without_nail = camera.frame(pose, nail_present=False)
        for name, frame in (("motion blur", blurred), ("instrument", covered), ("no nail", without_nail)):
            self._disturbed(name, frame)
            self._disturbed("the frame after these", still)
        x, y, z = pose.shift_mm
        away = Pose(pose.orbital_deg + _JUMP_DEG, pose.angular_deg, (x + _JUMP_MM, y, z))
        self._disturbed("the view jumps", camera.frame(away))
        self._disturbed("the frame after the jump", camera.frame(away))

    def _disturbed(self, name: str, frame: Frame) -> None:
        calibration = self._calibrated(frame)
        said = self._tally.events.setdefault(name, [])
        if calibration is None:
            said.append("not calibrated")
            return
        if self._track is None:
            said.append("waits for a full localisation")
            return
        sight = self._followed(frame, calibration)
        if sight.advice is None:
            said.append(sight.reasons[0].code.value)
        elif frame.truth.camera_from_nail is None:
            said.append("WRONG")
        else:
            said.append("WRONG" if self._wrong(sight.advice, frame, calibration) else "right answer")

    def _calibrated(self, frame: Frame) -> CArmCalibration | None:
        began = time.process_time()
        outcome = calibrate_next(frame.pixels, self._parts.ring, self._nominal, self._before)
        if isinstance(outcome, Rejected):
            return None
        if self._before is not None:
            self._tally.calibrate_s.append(time.process_time() - began)
        self._before = outcome.value
        return outcome.value

    def _localised(self, frame: Frame, calibration: CArmCalibration) -> tuple[FrameEstimate, Track | None]:
        began = time.process_time()
        found = localise(frame.pixels, calibration, self._parts)
        self._tally.full_s.append(time.process_time() - began)
        return begin_track(frame.pixels, calibration, self._parts, found)

    def _followed(self, frame: Frame, calibration: CArmCalibration) -> FrameEstimate:
        assert self._track is not None
        sight, self._track = track_frame(frame.pixels, calibration, self._parts, self._track)
        return sight

    def _off(self, told: Advice, frame: Frame, calibration: CArmCalibration) -> tuple[float, list[float]]:
        off, normalised = errors_of(told, frame.truth, calibration, self._parts.nail)
        return float(np.linalg.norm(off, axis=1).max()), normalised.ravel().tolist()

    def _wrong(self, told: Advice, frame: Frame, calibration: CArmCalibration) -> bool:
        off, normalised = errors_of(told, frame.truth, calibration, self._parts.nail)
        return bool(np.any((np.abs(normalised) > WRONG_DEVIATIONS) & (np.abs(off) > WRONG_DEG)))

    def _count(self, told: Advice, frame: Frame, calibration: CArmCalibration) -> None:
        off_deg, normalised = self._off(told, frame, calibration)
        print(f"  {off_deg:.2f} deg, normalised {np.round(normalised, 1)}", file=sys.stderr, flush=True)
        self._tally.answered += 1
        self._tally.followed_deg.append(off_deg)
        self._tally.normalised.extend(normalised)
        self._tally.wrong += self._wrong(told, frame, calibration)

    def _silent(self, code: str) -> None:
        self._tally.silent[code] = self._tally.silent.get(code, 0) + 1


def report(tally: Tally, scenes: int) -> str:
    """The tables."""
    follow, full, calibrate = (1e3 * float(np.median(t)) for t in (tally.follow_s, tally.full_s, tally.calibrate_s))
    lines = [
        _scenes_line(tally, scenes),
        "",
        "| one frame at a time, median | ms | frames/s | full localisations |",
        "|---|---|---|---|",
        f"| full localisation | {full:.0f} | {1e3 / full:.1f} | 1 |",
        f"| frame followed | {follow:.0f} | {1e3 / follow:.1f} | {follow / full:.3f} |",
        f"| its calibration | {calibrate:.0f} | {1e3 / calibrate:.1f} | {calibrate / full:.3f} |",
        "",
        "| error of the tilt at the worse hole | median | 95 % | worst | normalised, rms |",
        "|---|---|---|---|---|",
        _row("followed", tally.followed_deg, tally.normalised),
        _row("localised in full", tally.full_deg, tally.full_normalised),
        "",
        _answers_line(tally),
        "",
        "| disturbance | what the frame said |",
        "|---|---|",
    ]
    for name, said in tally.events.items():
        lines.append(f"| {name} | {_listed({word: said.count(word) for word in sorted(set(said))})} |")
    return "\n".join(lines)


def _scenes_line(tally: Tally, scenes: int) -> str:
    return (
        f"{scenes} scenes, {tally.good_frames} undisturbed frames; in {tally.not_begun} scenes the first frame was "
        "refused, and guidance waits there."
    )


def _answers_line(tally: Tally) -> str:
    return (
        f"Of {tally.answered} answers {tally.wrong} were wrong (off by more than {WRONG_DEVIATIONS:g} of their "
        f"standard deviations and {WRONG_DEG:g}°). Undisturbed frames without an answer: {_listed(tally.silent)}."
    )


def _row(name: str, off_deg: list[float], normalised: list[float]) -> str:
    middle, high = np.percentile(off_deg, [50, 95])
    rms = float(np.sqrt(np.mean(np.square(normalised))))
    return f"| {name} | {middle:.2f}° | {high:.2f}° | {max(off_deg):.2f}° | {rms:.2f} |"


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items()) or "none"


def main(scenes: int = SCENES) -> int:
    cv2.setNumThreads(1)
    tally = Tally()
    for seed in range(1, scenes + 1):
        film_scene(seed, tally)
        print(f"scene {seed}: {_answers_line(tally)}", file=sys.stderr, flush=True)
    text = report(tally, scenes)
    print(text)
    if scenes >= SCENES:
        about = (__doc__ or "").split("\n", 2)[2].strip()
        REPORT.write_text(f"# Guidance\n\nMade by `distalock bench guidance`. {about}\n\n{text}\n")
    return 1 if tally.wrong else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else SCENES))

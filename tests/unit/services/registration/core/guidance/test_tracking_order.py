"""Which estimates are published while two threads work on frames: none of an older frame after a newer one's."""

import numpy as np
import pytest

from services.registration.core.c_arm_advice import advice
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.guidance.measurement import NailAppearance
from services.registration.core.guidance.tracking import (
    FrameEstimate,
    Margin,
    NumberedFrame,
    Origin,
    Run,
    Track,
)
from shared.errors import Reason, ReasonCode
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import CAMERA_FROM_GUIDE, rendered_parts, turned_nail

PARTS = rendered_parts()
LEVEL, TILTED = (0.0, 0.0), (3.0, 0.0)
LOST = Reason(ReasonCode.NAIL_NOT_FOUND, "0 nails found (1 needed); show it")
FIRST, SECOND, THIRD = (NumberedFrame(name, number) for number, name in enumerate("abc", 1))


def guide_at(x_mm: float) -> Transform[Camera, Guide]:
    shift: Transform[Camera, Camera] = Transform.from_rotvec(np.zeros(3), [x_mm, 0.0, 0.0])
    return shift @ CAMERA_FROM_GUIDE


def track(x_mm: float = 0.0) -> Track:
    nail: Transform[Guide, Nail] = Transform.identity()
    appearance = NailAppearance(np.zeros(4), np.eye(6), 1.0, 1.2)
    return Track(PoseEstimate.of(nail, np.eye(6)), appearance, guide_at(x_mm), Margin(None, 0), 0)


def estimate(origin: Origin, tilts_deg: tuple[float, float] | None, x_mm: float = 0.0) -> FrameEstimate:
    if tilts_deg is None:
        return FrameEstimate(origin, None, None, (LOST,), guide_at(x_mm))
    turn = advice(turned_nail(tilts_deg), np.eye(6) * np.radians(0.1) ** 2, PARTS.nail)
    return FrameEstimate(origin, turn, Margin(None, 0), (), guide_at(x_mm))


def tracked(tilts_deg: tuple[float, float] | None, x_mm: float = 0.0) -> FrameEstimate:
    return estimate(Origin.FOLLOWED, tilts_deg, x_mm)


def localised(tilts_deg: tuple[float, float] | None) -> FrameEstimate:
    return estimate(Origin.LOCALISED, tilts_deg)


def test_an_older_frame_is_not_published_after_a_newer_one() -> None:
    run = Run()
    older, newer = run.start(), run.start()
    assert run.add_tracked(SECOND, newer, tracked(None), None)
    assert not run.add_tracked(FIRST, older, tracked(None), None)
    assert not run.add_localised(FIRST, localised(LEVEL), track()).publish
    assert run.add_localised(THIRD, localised(LEVEL), track()).publish
    assert not run.add_tracked(SECOND, run.start(), tracked(LEVEL), track())


def test_a_tracked_frame_localised_in_full_is_published_only_if_that_adds_something() -> None:
    run = Run(track())
    assert run.add_tracked(FIRST, run.start(), tracked(LEVEL), track())
    outcome = run.add_localised(FIRST, localised(LEVEL), track())
    assert (outcome.publish, outcome.contradicts, outcome.confirms) == (False, False, True)
    assert run.add_tracked(SECOND, run.start(), tracked(None), track())
    outcome = run.add_localised(SECOND, localised(LEVEL), track())
    assert (outcome.publish, outcome.contradicts, outcome.confirms) == (True, False, False)


@pytest.mark.parametrize("tilts_deg", [TILTED, None])
def test_a_contradicting_full_localisation_is_published_and_ends_the_track(
    tilts_deg: tuple[float, float] | None,
) -> None:
    run, begun = Run(track()), None if tilts_deg is None else track(5.0)
    run.add_tracked(FIRST, run.start(), tracked(LEVEL), track())
    start = run.start()
    outcome = run.add_localised(FIRST, localised(tilts_deg), begun)
    assert (outcome.publish, outcome.contradicts, outcome.confirms) == (True, True, False)
    assert run.track is begun
    # a frame tracked meanwhile from the contradicted track is not published and changes nothing
    assert not run.add_tracked(SECOND, start, tracked(LEVEL), track())
    assert run.track is begun
    assert run.add_tracked(THIRD, run.start(), tracked(LEVEL), track())


def test_a_check_during_a_run_keeps_the_newest_guide_pose() -> None:
    run = Run(track())
    for number, name in enumerate("abcdef", 1):
        run.add_tracked(NumberedFrame(name, number), run.start(), tracked(LEVEL, float(number)), track(float(number)))
    run.add_localised(NumberedFrame("b", 2), localised(LEVEL), track(2.0))
    assert run.track is not None
    assert run.track.camera_from_guide.translation_mm == pytest.approx(guide_at(6.0).translation_mm)
    run.add_localised(NumberedFrame("g", 7), localised(LEVEL), track(7.0))
    assert run.track.camera_from_guide.translation_mm == pytest.approx(guide_at(7.0).translation_mm)


def test_a_frame_tracked_during_a_check_moves_the_guide_of_the_new_track() -> None:
    run = Run(track())
    run.add_tracked(FIRST, run.start(), tracked(LEVEL, 1.0), track(1.0))
    start = run.start()
    new = track(1.0)
    run.add_localised(FIRST, localised(LEVEL), new)
    assert run.add_tracked(SECOND, start, tracked(LEVEL, 2.0), track(2.0))
    assert run.track is not None
    assert (run.track.guide_from_nail, run.track.appearance) == (new.guide_from_nail, new.appearance)
    assert run.track.camera_from_guide.translation_mm == pytest.approx(guide_at(2.0).translation_mm)


def test_an_untracked_image_that_is_not_localised_leaves_the_track() -> None:
    kept = track()
    run = Run(kept)
    assert run.add_localised(FIRST, localised(None), None).publish
    assert run.track is kept

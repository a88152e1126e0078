"""What may be said of frames while two hands work on them: no older frame after a newer one, nothing contradicted."""

import numpy as np
import pytest

from services.registration.core.c_arm_advice import advice
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.guidance.nail_tracking import NailAppearance
from services.registration.core.guidance.run import Arrival, Run
from services.registration.core.guidance.tracking import FrameEstimate, Key, Margin, Origin, Track
from shared.errors import Reason, ReasonCode
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import CAMERA_FROM_GUIDE, rendered_parts, turned_nail

PARTS = rendered_parts()
LEVEL, TILTED = (0.0, 0.0), (3.0, 0.0)
LOST = Reason(ReasonCode.NAIL_NOT_FOUND, "0 nails found (1 needed); show it")
FIRST, SECOND, THIRD = (Arrival(name, number) for number, name in enumerate("abc", 1))


def guide_at(x_mm: float) -> Transform[Camera, Guide]:
    shift: Transform[Camera, Camera] = Transform.from_rotvec(np.zeros(3), [x_mm, 0.0, 0.0])
    return shift @ CAMERA_FROM_GUIDE


def track(x_mm: float = 0.0) -> Track:
    nail: Transform[Guide, Nail] = Transform.identity()
    key = Key(PoseEstimate.of(nail, np.eye(6)), NailAppearance(np.zeros(4), np.eye(6), 1.0))
    return Track(key, guide_at(x_mm), Margin(None, 0), 0)


def sight(origin: Origin, tilts_deg: tuple[float, float] | None, x_mm: float = 0.0) -> FrameEstimate:
    if tilts_deg is None:
        return FrameEstimate(origin, None, None, (LOST,), guide_at(x_mm))
    told = advice(turned_nail(tilts_deg), np.eye(6) * np.radians(0.1) ** 2, PARTS.nail)
    return FrameEstimate(origin, told, Margin(None, 0), (), guide_at(x_mm))


def followed(tilts_deg: tuple[float, float] | None, x_mm: float = 0.0) -> FrameEstimate:
    return sight(Origin.FOLLOWED, tilts_deg, x_mm)


def localised(tilts_deg: tuple[float, float] | None) -> FrameEstimate:
    return sight(Origin.LOCALISED, tilts_deg)


def test_a_word_of_an_older_frame_is_not_told_after_that_of_a_newer() -> None:
    run = Run()
    older, newer = run.start(), run.start()
    assert run.followed(SECOND, newer, followed(None), None)
    assert not run.followed(FIRST, older, followed(None), None)
    assert not run.localised(FIRST, localised(LEVEL), track()).tell
    assert run.localised(THIRD, localised(LEVEL), track()).tell
    assert not run.followed(SECOND, run.start(), followed(LEVEL), track())


def test_the_same_frame_localised_in_full_is_told_only_if_that_says_more() -> None:
    run = Run(track())
    assert run.followed(FIRST, run.start(), followed(LEVEL), track())
    finding = run.localised(FIRST, localised(LEVEL), track())
    assert (finding.tell, finding.contradicts, finding.continues) == (False, False, True)
    assert run.followed(SECOND, run.start(), followed(None), track())
    finding = run.localised(SECOND, localised(LEVEL), track())
    assert (finding.tell, finding.contradicts, finding.continues) == (True, False, False)


@pytest.mark.parametrize("said", [TILTED, None])
def test_a_full_localisation_that_says_otherwise_is_told_and_ends_the_track(said: tuple[float, float] | None) -> None:
    run, begun = Run(track()), None if said is None else track(5.0)
    run.followed(FIRST, run.start(), followed(LEVEL), track())
    start = run.start()
    finding = run.localised(FIRST, localised(said), begun)
    assert (finding.tell, finding.contradicts, finding.continues) == (True, True, False)
    assert run.track is begun
    # a frame that was followed meanwhile from what was contradicted says nothing, and changes nothing
    assert not run.followed(SECOND, start, followed(LEVEL), track())
    assert run.track is begun
    assert run.followed(THIRD, run.start(), followed(LEVEL), track())


def test_a_check_in_the_middle_of_a_run_leaves_the_guide_where_the_newest_frame_showed_it() -> None:
    run = Run(track())
    for number, name in enumerate("abcdef", 1):
        run.followed(Arrival(name, number), run.start(), followed(LEVEL, float(number)), track(float(number)))
    run.localised(Arrival("b", 2), localised(LEVEL), track(2.0))
    assert run.track is not None
    assert run.track.camera_from_guide.translation_mm == pytest.approx(guide_at(6.0).translation_mm)
    run.localised(Arrival("g", 7), localised(LEVEL), track(7.0))
    assert run.track.camera_from_guide.translation_mm == pytest.approx(guide_at(7.0).translation_mm)


def test_a_frame_that_was_followed_during_a_check_moves_the_guide_of_the_new_track() -> None:
    run = Run(track())
    run.followed(FIRST, run.start(), followed(LEVEL, 1.0), track(1.0))
    start = run.start()
    new = track(1.0)
    run.localised(FIRST, localised(LEVEL), new)
    assert run.followed(SECOND, start, followed(LEVEL, 2.0), track(2.0))
    assert run.track is not None
    assert run.track.key is new.key
    assert run.track.camera_from_guide.translation_mm == pytest.approx(guide_at(2.0).translation_mm)


def test_an_image_that_says_nothing_and_was_not_followed_leaves_the_track() -> None:
    kept = track()
    run = Run(kept)
    assert run.localised(FIRST, localised(None), None).tell
    assert run.track is kept

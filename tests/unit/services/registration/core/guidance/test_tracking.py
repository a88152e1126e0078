"""Frames of running fluoroscopy: each measured by its own pixels, and rejected where these do not suffice."""

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.c_arm_advice import hole_tilts
from services.registration.core.guidance.measurement import mirror_margin, track_guide, track_nail
from services.registration.core.guidance.tracking import (
    FrameEstimate,
    Margin,
    Origin,
    Track,
    begin_track,
    disagree,
    track_frame,
)
from services.registration.core.localise import localise
from services.registration.core.nail.occluders import Occluders, PlacedGuide
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import FRAME_TRACKING
from shared.errors import Accepted, ReasonCode, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import (
    CAMERA_FROM_GUIDE,
    CAMERA_FROM_NAIL,
    Shown,
    rendered,
    rendered_parts,
)

PARTS = rendered_parts()


@dataclass(frozen=True, eq=False)
class Picture:
    pixels: NDArray[np.float32]
    calibration: CArmCalibration
    shown: Shown


def turned(about_x_deg: float, about_y_deg: float, shift_mm: tuple[float, float]) -> Shown:
    """What the C-arm sees after a turn about a point near the nail, and a shift."""
    turn = Rotation.from_euler("xy", [about_x_deg, about_y_deg], degrees=True)
    pivot = np.array([0.0, 0.0, 740.0])
    moved: Transform[Camera, Camera] = Transform.from_rotation_translation(
        turn.as_matrix(), pivot - turn.apply(pivot) + np.array([*shift_mm, 0.0])
    )
    return Shown(moved @ CAMERA_FROM_GUIDE, moved @ CAMERA_FROM_NAIL)


def picture(shown: Shown, seed: int) -> Picture:
    return Picture(*rendered(shown, seed), shown)


@cache
def still() -> Picture:
    """The first view once more, with other noise."""
    return picture(Shown(), 2)


@cache
def empty() -> Picture:
    """The first view without the nail."""
    return picture(Shown(nail=None), 4)


@cache
def begun() -> tuple[Picture, FrameEstimate, Track]:
    """A first image, what its localisation says, and the track that begins with it."""
    first = picture(Shown(), 1)
    found = localise(first.pixels, first.calibration, PARTS)
    estimate, track = begin_track(first.pixels, first.calibration, PARTS, found)
    assert track is not None
    return first, estimate, track


def deviations(sight: FrameEstimate, shown: Shown) -> NDArray[np.float64]:
    """Errors of all tilts over their standard deviations, shape (H, 2)."""
    assert sight.advice is not None, sight.reasons
    assert shown.nail is not None
    sd = np.array([sight.advice.about_x_sd_deg, sight.advice.about_y_sd_deg])
    pairs = zip(sight.advice.tilts, hole_tilts(shown.nail, PARTS.nail), strict=True)
    off = np.array([(a.about_x_deg - b.about_x_deg, a.about_y_deg - b.about_y_deg) for a, b in pairs])
    return np.asarray(off / sd)


def test_a_turned_and_shifted_view_is_followed() -> None:
    now = picture(turned(1.2, -0.8, (2.0, -3.0)), 2)
    sight, track = track_frame(now.pixels, now.calibration, PARTS, begun()[2])
    assert sight.origin is Origin.FOLLOWED
    assert np.abs(deviations(sight, now.shown)).max() < 4.0
    assert sight.advice is not None
    assert max(sight.advice.about_x_sd_deg, sight.advice.about_y_sd_deg) < 0.6
    assert track is not None
    assert track.frames_without_estimate == 0


def test_a_view_follows_from_the_one_before_it_and_not_only_from_the_key() -> None:
    track: Track | None = begun()[2]
    for step in (1, 2):
        now = picture(turned(1.5 * step, 0.0, (4.0 * step, 0.0)), 10 + step)
        assert track is not None
        sight, track = track_frame(now.pixels, now.calibration, PARTS, track)
        assert np.abs(deviations(sight, now.shown)).max() < 4.0


def test_a_mirrored_display_is_followed_as_well() -> None:
    now = picture(replace(turned(0.5, 0.5, (1.0, 0.0)), mirrored=True), 3)
    sight, _ = track_frame(now.pixels, now.calibration, PARTS, begun()[2])
    assert np.abs(deviations(sight, now.shown)).max() < 4.0


def test_a_frame_without_the_nail_says_so_and_the_next_one_goes_on() -> None:
    first, _, track = begun()
    sight, after = track_frame(empty().pixels, empty().calibration, PARTS, track)
    assert sight.advice is None
    assert sight.reasons[0].code in {ReasonCode.HOLE_NOT_VISIBLE, ReasonCode.NAIL_MODEL_MISMATCH}
    assert after is not None
    assert after.frames_without_estimate == 1
    again, after = track_frame(first.pixels, first.calibration, PARTS, after)
    assert again.advice is not None
    assert after is not None
    assert after.frames_without_estimate == 0


def test_a_track_ends_when_too_many_frames_in_a_row_were_silent() -> None:
    nearly = replace(begun()[2], frames_without_estimate=FRAME_TRACKING.most_missed - 1)
    _, after = track_frame(empty().pixels, empty().calibration, PARTS, nearly)
    assert after is None


def test_a_jump_is_said_first_and_found_by_the_frame_after_it() -> None:
    now = picture(turned(1.0, 0.0, (-32.0, 0.0)), 12)
    said, lost = track_frame(now.pixels, now.calibration, PARTS, begun()[2])
    assert [reason.code for reason in said.reasons] == [ReasonCode.GUIDE_NOT_FOUND]
    assert lost is not None
    sight, found = track_frame(now.pixels, now.calibration, PARTS, lost)
    assert np.abs(deviations(sight, now.shown)).max() < 4.0
    assert found is not None
    assert found.frames_without_estimate == 0


def test_a_covered_hole_is_not_answered() -> None:
    now = still()
    middle = CAMERA_FROM_NAIL @ PARTS.nail.holes[0].axis.point_mm
    x, y = (round(float(v)) for v in now.calibration.image_from_camera(middle))
    covered = now.pixels.copy()
    cv2.line(covered, (x, y), (x + 300, y + 200), float(np.percentile(covered, 1.0)), 40)
    sight, _ = track_frame(covered, now.calibration, PARTS, begun()[2])
    assert sight.advice is None
    assert "move what covers it" in sight.reasons[0].message or "take away" in sight.reasons[0].message


def test_a_blurred_nail_is_not_answered() -> None:
    now = still()
    smeared = cv2.blur(now.pixels, (21, 1))
    sight, _ = track_frame(np.asarray(smeared, dtype=np.float32), now.calibration, PARTS, begun()[2])
    assert sight.advice is None


def test_a_guide_that_left_is_not_found_where_it_was() -> None:
    away = picture(Shown(guide=None), 7)
    found = track_guide(away.calibration, PARTS.guide, CAMERA_FROM_GUIDE)
    assert isinstance(found, Rejected)
    assert found.reasons[0].code is ReasonCode.GUIDE_NOT_FOUND
    assert "at least 12" in found.reasons[0].message


def test_the_guide_is_found_where_it_is_now() -> None:
    now = picture(turned(2.0, 1.0, (6.0, -5.0)), 8)
    found = track_guide(now.calibration, PARTS.guide, CAMERA_FROM_GUIDE)
    assert isinstance(found, Accepted)
    assert now.shown.guide is not None
    apart = now.shown.guide.inverse() @ found.value.mean
    assert np.degrees(np.linalg.norm(apart.rotation_vector_rad)) < 0.3
    assert np.linalg.norm(apart.translation_mm[:2]) < 0.1


def test_a_guide_that_was_moved_against_the_nail_is_noticed() -> None:
    moved: Transform[Camera, Camera] = Transform.from_rotvec(np.zeros(3), [0.0, 4.0, 0.0])
    now = picture(Shown(guide=moved @ CAMERA_FROM_GUIDE), 9)
    sight, _ = track_frame(now.pixels, now.calibration, PARTS, begun()[2])
    assert sight.advice is None


def test_the_mirrored_tilt_is_looked_at_when_it_is_due_and_its_age_is_told() -> None:
    now = still()
    before = replace(begun()[2], margin=Margin(5000.0, FRAME_TRACKING.check_every - 2))
    sight, after = track_frame(now.pixels, now.calibration, PARTS, before)
    assert sight.margin == Margin(5000.0, FRAME_TRACKING.check_every - 1)
    assert after is not None
    sight, _ = track_frame(now.pixels, now.calibration, PARTS, after)
    assert sight.margin is not None
    assert sight.margin.frames_ago == 0
    assert sight.margin.log_likelihood_ratio != 5000.0


def test_the_mirrored_tilt_is_compared_whatever_the_fit_weighed_less() -> None:
    """Weights by the pose that was found would hide what speaks for the other one."""
    _, _, track = begun()
    seen = still()
    balls = Occluders(PlacedGuide(PARTS.guide, CAMERA_FROM_GUIDE), PARTS.ring)
    given = FitInput(seen.pixels, seen.calibration, PARTS.nail, balls)
    followed = track_nail(given, track.appearance, CAMERA_FROM_NAIL)
    assert isinstance(followed, Accepted), followed
    found = followed.value
    dismissive = replace(found.problem, weight=1e-3 * found.problem.weight)
    assert mirror_margin(replace(found, problem=dismissive)) == mirror_margin(found)
    assert mirror_margin(found) is not None


def test_disagreement_is_more_than_both_allow() -> None:
    _, sight, _ = begun()
    told = sight.advice
    assert told is not None
    far = tuple(replace(tilt, about_x_deg=tilt.about_x_deg + 8.0 * told.about_x_sd_deg) for tilt in told.tilts)
    assert not disagree(sight, sight)
    assert disagree(sight, replace(sight, advice=replace(told, tilts=far)))
    assert disagree(sight, replace(sight, advice=None))
    assert not disagree(replace(sight, advice=None), sight)


def test_a_refused_localisation_begins_no_track_unless_it_is_only_tilted_or_unsure() -> None:
    found = localise(empty().pixels, empty().calibration, PARTS)
    estimate, track = begin_track(empty().pixels, empty().calibration, PARTS, found)
    assert track is None
    assert estimate.advice is None

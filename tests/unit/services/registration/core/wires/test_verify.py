"""K-wires on rendered images: measured where they are, refused where one image cannot say."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from services.registration.core.wires.image import RegisteredImage
from services.registration.core.wires.verify import WireVerification, verify_guide_holes, verify_wires
from shared.errors import ReasonCode
from tests.unit.services.registration.core.wires.wire_scene import (
    ALONG_THE_GUIDE,
    ASKEW,
    GUIDE_COVARIANCE,
    GUIDE_FROM_NAIL,
    LATERAL,
    SIZE_PX,
    WIRE_DIAMETER_MM,
    Wired,
    assert_explains,
    joint,
    oblique,
    true_offsets_mm,
    verified,
    view_of,
)
from tests.unit.services.registration.rendered_case import rendered_parts
from tests.unit.services.registration.xray_scene import (
    Scene,
    calibration,
    guide_part,
    nail_part,
    render,
)

WIRES = {"along the guide": ALONG_THE_GUIDE, "askew in the guide": ASKEW}


@cache
def verified_pair(name: str) -> WireVerification:
    return verified(view_of(LATERAL, WIRES[name], seed=31), view_of(oblique(38.0), WIRES[name], seed=32))


@pytest.mark.requirement("REG-12")
@pytest.mark.parametrize("name", WIRES)
def test_a_pair_of_images_measures_both_wires(name: str) -> None:
    result, wires = verified_pair(name), WIRES[name]
    assert result.reasons == ()
    assert [wire.hole.id for wire in result.wires] == ["distal", "proximal"]
    for wire in result.wires:
        assert_explains(wire, wires)
        entry_mm, _ = true_offsets_mm(wires, wire.hole.id)
        assert wire.offset.entry_mm == pytest.approx(entry_mm, abs=0.3)
        assert wire.offset.entry_sd_mm < 0.4


def test_wires_along_the_holes_let_the_drill_pass() -> None:
    assert [wire.chance_as_it_stands > 0.9 for wire in verified_pair("along the guide").wires] == [True, True]


@pytest.mark.requirement("REG-12")
def test_wires_askew_do_not() -> None:
    assert [wire.chance_as_it_stands < 0.05 for wire in verified_pair("askew in the guide").wires] == [True, True]


def test_the_lateral_image_alone_sees_the_stubs() -> None:
    result = verified(view_of(LATERAL, ASKEW, seed=37))
    assert len(result.wires) == 2
    for wire in result.wires:
        assert_explains(wire, ASKEW)
        assert wire.offset.entry_sd_mm < 1.6


@pytest.mark.requirement("REG-12")
def test_one_oblique_image_leaves_a_plane_open_and_is_refused() -> None:
    result = verified(view_of(oblique(38.0), ASKEW, seed=38))
    assert {reason.code for reason in result.reasons} == {ReasonCode.UNCERTAINTY_TOO_LARGE}
    assert "add an image from another direction" in result.reasons[0].message
    for wire in result.wires:
        assert wire.offset.entry_sd_mm > 2.0
        assert_explains(wire, ASKEW)


@pytest.mark.requirement("REG-12")
def test_without_wires_there_are_none() -> None:
    result = verified(view_of(LATERAL, Wired({}), seed=39))
    assert result.wires == ()
    assert [reason.code for reason in result.reasons] == [ReasonCode.WIRE_NOT_FOUND] * 2
    assert "guide hole 'distal'" in result.reasons[0].message


def test_a_plastic_rod_is_no_wire() -> None:
    pose, camera = oblique(38.0), calibration(SIZE_PX)
    rods = tuple(replace(rod, per_mm=0.09) for rod in ALONG_THE_GUIDE.rods(pose, 112.0))
    scene = Scene(SIZE_PX, nail_part(), pose @ GUIDE_FROM_NAIL, rods, texture=0.02, noise=0.003)
    result = verified(RegisteredImage(render(scene, camera, seed=47), camera, pose, GUIDE_COVARIANCE))
    assert [reason.code for reason in result.reasons] == [ReasonCode.WIRE_NOT_FOUND] * 2


def test_one_wire_of_two_is_still_measured() -> None:
    one = Wired({"proximal": np.zeros(4)})
    result = verified(view_of(LATERAL, one, seed=41), view_of(oblique(38.0), one, seed=42))
    assert [wire.hole.id for wire in result.wires] == ["proximal"]
    assert [reason.code for reason in result.reasons] == [ReasonCode.WIRE_NOT_FOUND]


def test_the_guides_own_holes_are_compared_too() -> None:
    result = verified(view_of(LATERAL, Wired({}), seed=43))
    for hole in result.guide_holes:
        entry_mm, exit_mm = true_offsets_mm(ALONG_THE_GUIDE, hole.hole.id)
        assert (hole.offset.entry_mm, hole.offset.exit_mm) == pytest.approx((entry_mm, exit_mm), abs=1e-9)
        assert hole.angle_deg == pytest.approx(0.5, abs=0.01)
        assert hole.offset.entry_sd_mm == pytest.approx(0.02 * np.sqrt(2.0))


def test_the_guide_alone_needs_no_wires() -> None:
    estimate = joint(view_of(LATERAL, Wired({}), seed=43))
    parts = replace(rendered_parts(), guide=guide_part(), nail=nail_part())
    result = verify_guide_holes(estimate, parts)
    assert (result.reasons, result.wires) == ((), ())
    for hole in result.guide_holes:
        entry_mm, exit_mm = true_offsets_mm(ALONG_THE_GUIDE, hole.hole.id)
        assert (hole.offset.entry_mm, hole.offset.exit_mm) == pytest.approx((entry_mm, exit_mm), abs=1e-9)


@pytest.mark.requirement("REG-12")
def test_a_guide_that_is_not_known_well_enough_is_rejected() -> None:
    estimate = joint(view_of(LATERAL, Wired({}), seed=43))
    vague = replace(estimate, covariance=1e4 * estimate.covariance)
    result = verify_guide_holes(vague, replace(rendered_parts(), guide=guide_part(), nail=nail_part()))
    assert [reason.code for reason in result.reasons] == [ReasonCode.UNCERTAINTY_TOO_LARGE] * len(result.guide_holes)
    assert "guide hole 'distal' is known to" in result.reasons[0].message
    assert "take one more image along the holes" in result.reasons[0].message


def test_holes_that_do_not_belong_together_are_refused() -> None:
    nail = nail_part()
    others = replace(nail, holes=tuple(replace(hole, id=f"other {hole.id}") for hole in nail.holes))
    result = verify_wires(
        joint(view_of(LATERAL, Wired({}), seed=44)),
        replace(rendered_parts(), guide=guide_part(), nail=others),
        WIRE_DIAMETER_MM,
    )
    assert [reason.code for reason in result.reasons] == [ReasonCode.NAIL_MODEL_MISMATCH]

"""In rendered rooms: a guide on back to front shows in the first image, a wrong extension in the first move."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.registration.core.acceptance.criteria import HeadTrouble
from services.registration.core.head_check import MotionView, check_motion
from services.registration.core.localise import LocalisationResult, Parts, localise
from services.registration.core.plan import RobotNow, plan_move
from services.registration.planning import motion_view
from shared.acceptance import Refusal
from shared.equipment import USUAL_DRILL_DIAMETER_MM
from shared.errors import Accepted, ReasonCode
from shared.geometry.frames import Guide
from shared.geometry.hexapod import PlatformPose, base_from_top
from shared.geometry.transform import Transform
from simulation.render.image import render_scene
from simulation.scenario.sampling import scenario_of_seed
from simulation.scenario.values import Scenario
from simulation.world.poses import starting_state

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
TURNED_SEED = 315
# A room whose first move turns the guide by 6°, across the head's axis.
EXTENSION_SEED = 364


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """What the product says of one image of a room."""

    result: LocalisationResult
    view: MotionView | None


def image_of(scenario: Scenario, pose: PlatformPose, shot: int) -> Image:
    hexapod = scenario.parts.hexapod
    state = replace(starting_state(scenario), platform=base_from_top(hexapod, pose, hexapod.pivot_mm))
    pixels = render_scene(scenario, state, shot).pixels.astype(np.float32)
    nominal = NominalGeometry(scenario.c_arm.nominal_source_to_detector_mm, scenario.c_arm.nominal_pixel_mm)
    calibrated = calibrate_image(pixels, scenario.parts.ring, nominal)
    assert isinstance(calibrated, Accepted)
    parts = Parts(scenario.parts.ring, scenario.parts.guide, scenario.parts.nail, USUAL_DRILL_DIAMETER_MM)
    result = localise(pixels, calibrated.value, parts)
    print([reason.message for reason in result.reasons])
    return Image(result, motion_view(pose, calibrated.value, result))


def test_a_guide_on_back_to_front_contradicts_the_nails_tip() -> None:
    print(f"seed {TURNED_SEED}")
    scenario = scenario_of_seed(TURNED_SEED)
    hexapod = scenario.parts.hexapod
    turn: Transform[Guide, Guide] = Transform.from_rotvec([0.0, 0.0, np.pi], np.zeros(3))
    turned = replace(hexapod, top_from_guide_retracted=hexapod.top_from_guide_retracted @ turn)
    scenario = replace(scenario, parts=replace(scenario.parts, hexapod=turned))
    image = image_of(scenario, hexapod.home_pose, 1)
    assert [reason.code for reason in image.result.reasons] == [ReasonCode.NAIL_MODEL_MISMATCH]
    assert "how the guide is mounted" in image.result.reasons[0].message


@pytest.mark.long
def test_an_extension_entered_10_mm_wrong_shows_in_a_first_move_that_turns() -> None:
    scenario = scenario_of_seed(EXTENSION_SEED)
    hexapod = scenario.parts.hexapod
    entered_mm = scenario.head_extension_mm + 10.0
    before = image_of(scenario, hexapod.home_pose, 1)
    assert before.result.holes is not None
    robot = RobotNow(hexapod, hexapod.home_pose, np.array(hexapod.pivot_mm), entered_mm)
    plan = plan_move(before.result.holes, scenario.parts.guide, tuple(h.id for h in before.result.holes), robot)
    assert not isinstance(plan, Refusal), plan
    print(
        f"seed {EXTENSION_SEED}: {plan.value.travel_mm:.1f} mm, {plan.value.travel_deg:.1f}°, {plan.value.target_pose}"
    )
    after = image_of(scenario, plan.value.target_pose, 2)
    assert before.view is not None
    assert after.view is not None
    refused = check_motion(hexapod, entered_mm, before.view, after.view)
    print(refused)
    assert refused is not None
    assert refused.code is HeadTrouble.HEAD_EXTENSION
    # to the millimetre: its standard uncertainty is 1 mm
    assert f"extension at {scenario.head_extension_mm:.0f} ± 1 mm" in refused.message
    assert check_motion(hexapod, scenario.head_extension_mm, before.view, after.view) is None, "as it really is"

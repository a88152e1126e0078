"""Motions over REST in the rig that times stops: its process stands in for registration, and answers with any plan."""

import random
import time
from typing import Final

from benchmarks.robot.plans import HOLE_IDS, NO_SHA, plan_between, random_target
from benchmarks.robot.stop_latency_rig import KEYS, PATIENCE_S, TARGET_SIZE, StopRig
from distalock.case_client import CaseClient
from distalock.client import Client
from distalock.client.models import OperationView
from shared.bus.port import Answer, Query
from shared.messages.base import encode
from shared.messages.imaging import ImageReference
from shared.messages.registration import Localisation, LocalisationRecord, LocalisedImage, Plan, PlanReply, Timing

MOST_NOT_BEGUN: Final = 20
# A command that is older than that is never carried out.
_BEGINS_WITHIN_S: Final = 3.0


class PlannedMotions:
    """Plans, approves and moves, as a console does.

    Attributes
    ----------
    rig
        Whose registration it stands in for.
    not_begun
        Motions whose command came too late for the robot to begin.
    """

    def __init__(self, rig: StopRig) -> None:
        self.rig = rig
        self.not_begun = 0
        self._next: Plan | None = None
        self._last: OperationView | None = None
        self._case = CaseClient(Client(rig.installation.ports.rest_url, rig.installation.token), rig.case[0])
        rig.registration.queryable(KEYS.plan_request, self._plan)
        rig.registration.retained_publisher(KEYS.localisation).put(encode(self._record()))
        self._wait_for_localisation()

    def motion_latency_s(self, source: random.Random) -> float:
        """One trial: time a move from its request to its command at the controller; repeated where it never began."""
        while (latency_s := self._attempt_s(source)) is None:
            self.not_begun += 1
            if self.not_begun > MOST_NOT_BEGUN:
                raise TimeoutError(f"{self.not_begun} motions did not begin; the robot is {self.rig.state}")
        return latency_s

    def _attempt_s(self, source: random.Random) -> float | None:
        state = self.rig.make_ready()
        if state.pose is None:
            raise TimeoutError(f"the robot has no pose; it is {state}")
        if self._last is not None:
            self._case.follow(self._last)  # or its end would be a change since the case was read
        start, target = state.pose.value(), random_target(source, TARGET_SIZE)
        self._next = plan_between(start, target, self.rig.epoch, state.boot_epoch, self.rig.case)
        plan = self._case.plan(1, HOLE_IDS)
        self._case.approve(plan)
        self.rig.controller.move_heard.clear()
        asked_s = time.monotonic()  # the client reads the case first, as a console does
        self._last = self._case.begin_motion(plan)
        if not self.rig.controller.move_heard.wait(_BEGINS_WITHIN_S):
            return None
        return self.rig.controller.moved_s - asked_s

    def _plan(self, _: Query) -> Answer:
        assert self._next is not None
        plans = self.rig.registration.retained_publisher(KEYS.plan)
        plans.put(encode(self._next))
        plans.close()
        return Answer(encode(PlanReply(verdict="accepted", plan=self._next)))

    def _record(self) -> LocalisationRecord:
        """An accepted localisation of some image, from which a plan may be asked for."""
        localisation = Localisation(
            verdict="accepted",
            reasons=(),
            method="model",
            image=LocalisedImage(sha256=NO_SHA, mirrored=False),
            camera=None,
            guide=None,
            nail=None,
            guide_from_nail=None,
            holes=None,
            c_arm_correction_deg=None,
            timing_ms=Timing(total=1.0),
        )
        return LocalisationRecord(
            localisation=localisation,
            image=ImageReference(sha256=NO_SHA, sop_instance_uid="1.2.3", sequence=1, received_at_ns=time.time_ns()),
            case_id=self.rig.case[0],
            case_revision=self.rig.case[1],
            registration_epoch=self.rig.epoch,
            robot_boot_epoch=None,
            robot_pose=None,
            ring_sha256=NO_SHA,
            guide_sha256=NO_SHA,
            nail_sha256=NO_SHA,
            software_version="benchmark",
        )

    def _wait_for_localisation(self) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while self.rig.rest.get(f"/api/v1/cases/{self._case.id}")["localisations"] != 1:
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"no localisation was recorded within {PATIENCE_S:g} s")
            time.sleep(0.05)

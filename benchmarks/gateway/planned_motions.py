"""Motions over REST in the rig that times stops: its process stands in for registration, and answers with any plan."""

import random
import time
from collections import Counter
from typing import Final

from benchmarks.gateway.stand_in_registration import StandInRegistration
from benchmarks.robot.plans import HOLE_IDS, plan_between, reachable_target
from benchmarks.robot.stop_latency_rig import TARGET_SIZE, StopRig
from distalock.case_client import CaseClient
from distalock.client import Client
from distalock.client.models import MotionBody, OperationView

MOST_NOT_BEGUN: Final = 20
# More than the time to live of a command, which is never carried out later.
_BEGINS_WITHIN_S: Final = 3.0


class PlannedMotions:
    """Plans, approves and moves, as a console does.

    Attributes
    ----------
    rig
        Whose registration it stands in for.
    not_begun
        Motions that did not begin, by the code and the words with which their operation ended.
    """

    def __init__(self, rig: StopRig) -> None:
        self.rig = rig
        self.not_begun: Counter[str] = Counter()
        self._last: OperationView | None = None
        self._client = Client(rig.installation.ports.rest_url, rig.installation.token)
        self._case = CaseClient(self._client, rig.case[0])
        self._registration = StandInRegistration(rig)

    def motion_latency_s(self, source: random.Random) -> float:
        """One trial: time a move from its request to its command at the controller; repeated where it never began."""
        while (latency_s := self._attempt_s(source)) is None:
            if self.not_begun.total() > MOST_NOT_BEGUN:
                raise TimeoutError(f"motions did not begin: {dict(self.not_begun)}; the robot is {self.rig.state}")
        return latency_s

    def _attempt_s(self, source: random.Random) -> float | None:
        state = self.rig.make_ready()
        if state.pose is None:
            raise TimeoutError(f"the robot has no pose; it is {state}")
        if self._last is not None:
            self._case.follow(self._last)  # or its end would be a change since the case was read
        start = state.pose.value()
        target = reachable_target(source, start, TARGET_SIZE)
        offered = plan_between(start, target, self.rig.epoch, state.boot_epoch, self.rig.case)
        plan = self._case.plan(self._registration.offer(offered), HOLE_IDS)
        self._case.approve(plan)
        self.rig.controller.move_heard.clear()
        self._case.read()  # as a console, which has read the case before somebody presses the button
        asked_s = time.monotonic()
        self._last = self._client.begin_motion(self._case.id, MotionBody(plan=plan.number))
        if not self.rig.controller.move_heard.wait(_BEGINS_WITHIN_S):
            ended = self._case.follow(self._last)
            self.not_begun[f"{ended.code or ended.status}: {ended.detail}"] += 1
            return None
        return self.rig.controller.moved_s - asked_s

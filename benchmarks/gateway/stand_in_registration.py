"""Stands in for registration beside a real gateway and robot: one localisation, and any plan."""

import time
from typing import Final

from benchmarks.robot.plans import NO_SHA
from benchmarks.robot.stop_latency_rig import KEYS, PATIENCE_S, StopRig
from shared.bus.port import Answer, Query
from shared.messages.base import encode
from shared.messages.imaging import ImageReference
from shared.messages.registration import Localisation, LocalisationRecord, LocalisedImage, Plan, PlanReply, Timing

# Its only localisation, of some image, from which a plan may be asked for.
LOCALISATION: Final = 1
_POLL_S: Final = 0.05


class StandInRegistration:
    """Answers each request for a plan with the one that was offered last."""

    def __init__(self, rig: StopRig) -> None:
        self._rig = rig
        self._next: Plan | None = None
        rig.registration.queryable(KEYS.plan_request, self._plan)
        rig.registration.retained_publisher(KEYS.localisation).put(encode(self._record()))
        self._wait_for_localisation()

    def offer(self, plan: Plan) -> None:
        """From now on this is the plan."""
        self._next = plan

    def _plan(self, _: Query) -> Answer:
        assert self._next is not None
        plans = self._rig.registration.retained_publisher(KEYS.plan)
        plans.put(encode(self._next))
        plans.close()
        return Answer(encode(PlanReply(verdict="accepted", plan=self._next)))

    def _record(self) -> LocalisationRecord:
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
            case_id=self._rig.case[0],
            case_revision=self._rig.case[1],
            registration_epoch=self._rig.epoch,
            robot_boot_epoch=None,
            robot_pose=None,
            ring_sha256=NO_SHA,
            guide_sha256=NO_SHA,
            nail_sha256=NO_SHA,
            software_version="benchmark",
        )

    def _wait_for_localisation(self) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while self._rig.rest.get(f"/api/v1/cases/{self._rig.case[0]}")["localisations"] != LOCALISATION:
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"no localisation was recorded within {PATIENCE_S:g} s")
            time.sleep(_POLL_S)

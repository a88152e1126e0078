"""Stands in for registration beside a real gateway and robot: an image of now, and any plan from it."""

import hashlib
import time
from typing import Final

from benchmarks.robot.plans import NO_SHA
from benchmarks.robot.stop_latency_rig import KEYS, PATIENCE_S, StopRig
from shared.bus.port import Answer, Query
from shared.messages.base import encode
from shared.messages.imaging import ImageReference
from shared.messages.registration import Localisation, LocalisationRecord, LocalisedImage, Plan, PlanReply, Timing

_POLL_S: Final = 0.05


class StandInRegistration:
    """Answers each request for a plan with the one that was offered last."""

    def __init__(self, rig: StopRig) -> None:
        self._rig = rig
        self._next: Plan | None = None
        self._images = 0
        self._localised = rig.registration.retained_publisher(KEYS.localisation)
        rig.registration.queryable(KEYS.plan_request, self._plan)

    def offer(self, plan: Plan) -> int:
        """Localise an image of now, because one of before a motion is stale, and make this the plan from it.

        Returns
        -------
        int
            Number of the localisation.
        """
        self._images += 1
        sha256 = hashlib.sha256(f"image {self._images}".encode()).hexdigest()
        self._localised.put(encode(self._record(sha256)))
        self._wait_for_localisation()
        self._next = plan.model_copy(update={"image_sha256": sha256})
        return self._images

    def _plan(self, _: Query) -> Answer:
        assert self._next is not None
        plans = self._rig.registration.retained_publisher(KEYS.plan)
        plans.put(encode(self._next))
        plans.close()
        return Answer(encode(PlanReply(verdict="accepted", plan=self._next)))

    def _record(self, image_sha256: str) -> LocalisationRecord:
        localisation = Localisation(
            verdict="accepted",
            reasons=(),
            method="model",
            image=LocalisedImage(sha256=image_sha256, mirrored=False),
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
            image=ImageReference(
                sha256=image_sha256,
                sop_instance_uid=f"1.2.{self._images}",
                sequence=self._images,
                received_at_ns=time.time_ns(),
            ),
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
        while self._rig.rest.get(f"/api/v1/cases/{self._rig.case[0]}")["localisations"] != self._images:
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"no localisation was recorded within {PATIENCE_S:g} s")
            time.sleep(_POLL_S)

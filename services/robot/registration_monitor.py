"""Listens to registration and to the gateway's open case: what a motion rests on, and what forbids one."""

import threading
from collections.abc import Callable

from services.robot import message_mapping
from services.robot.core.plans import RegistrationView
from services.robot.drive.drive import Drive
from shared.bus.keys import Keys
from shared.bus.port import Bus, Sample
from shared.errors import InputError
from shared.messages.base import decode
from shared.messages.cases import CaseContext
from shared.messages.registration import RegistrationEpoch


class RegistrationMonitor:
    """Keeps what was heard. Something in the guide or the bone stops a motion that has begun.

    Parameters
    ----------
    lock
        Whoever decides on a motion holds it until the motion has begun or was refused, so that nothing is put into the
        bone unnoticed in between.
    clock_s
        Monotonic clock.
    """

    def __init__(self, drive: Drive, lock: threading.Lock, clock_s: Callable[[], float]) -> None:
        self._drive = drive
        self._lock = lock
        self._clock_s = clock_s
        self.view = RegistrationView()

    def listen(self, bus: Bus, keys: Keys) -> None:
        """Subscribe."""
        bus.subscribe(keys.registration_epoch, self._on_epoch)
        bus.presence().watch_alive(keys.alive("registration"), self._on_alive)
        bus.subscribe_retained(keys.plan, self._on_plan)
        bus.subscribe_retained(keys.case_context, self._on_case)

    def _on_epoch(self, sample: Sample) -> None:
        heard_s = self._clock_s()
        try:
            report = message_mapping.epoch_report(decode(RegistrationEpoch, sample.payload), heard_s)
        except InputError:
            self._forget_epoch()
            raise
        with self._lock:
            self.view = self.view.with_epoch_report(report)

    def _on_alive(self, key: str, alive: bool) -> None:  # noqa: FBT001 - the signature is the bus's
        del key
        if not alive:
            self._forget_epoch()

    def _forget_epoch(self) -> None:
        with self._lock:
            self.view = self.view.without_epoch()

    def _on_plan(self, sample: Sample) -> None:
        plan = message_mapping.planned_move(sample.payload)
        with self._lock:
            self.view = self.view.with_plan(plan, self._clock_s())

    def _on_case(self, sample: Sample) -> None:
        try:
            context = decode(CaseContext, sample.payload)
        except InputError:
            with self._lock:
                self.view = self.view.without_case()
            self._drive.supervision_lost(
                "what is in the bone is not known: the report of the open case cannot be read; run services of one "
                "version"
            )
            raise
        inside = message_mapping.inside(context)
        with self._lock:
            self.view = self.view.with_case(context.case_id, context.revision, inside)
        if inside:
            self._drive.supervision_lost(f"the case says: {', '.join(inside)}; nothing moves before it is taken out")

"""What may happen to a watched rig: what people do, rightly or wrongly, faults, and others that fail."""

from collections.abc import Callable

from benchmarks.robot.plans import random_target
from benchmarks.robot.rig import FOREIGN_SIGNER
from benchmarks.robot.watched import UNHEARD, Watched
from shared.errors import NoReply
from shared.geometry.hexapod import PlatformPose
from shared.messages.base import encode
from shared.robot_states import MotionState
from simulation.controller.faults import Fault

TARGET_SIZE = 0.3


def _sensible_step(w: Watched) -> None:
    """What somebody at a console would do next."""
    rig = w.rig
    match rig.status.state:
        case MotionState.STOPPED:
            w.ask(rig.plain("acknowledge_stop"))
        case MotionState.UNREFERENCED:
            w.ask(rig.plain("reference"))
        case MotionState.FAULT:
            w.ask(rig.plain("reset"))
        case MotionState.LOCKED:
            _plan(w)
            _move(w)
        case _:
            w.tick()


def _plan(w: Watched) -> None:
    w.plan_target = random_target(w.rig.random, TARGET_SIZE)
    w.plan_json = w.rig.publish_plan(w.plan_target)


def _move(w: Watched) -> None:
    if w.plan_json is None or w.plan_target is None:
        return
    start = w.rig.virtual.snapshot().pose
    reply = w.ask(w.rig.move(w.plan_json))
    if reply is not None and reply.verdict == "accepted":
        w.accepted.append(w.plan_target)
        w.way = (start, w.plan_target)
        w.unheard_since_move = bool(w.faults & UNHEARD)


def _move_forged(w: Watched) -> None:
    target = random_target(w.rig.random, TARGET_SIZE)
    unpublished = w.rig.publish_plan(target) if w.rig.random.random() < 0.5 else _unpublished(w, target)
    reply = w.ask(w.rig.move(unpublished, signer=FOREIGN_SIGNER))
    if reply is not None and reply.verdict == "accepted":
        w.wrong.append(f"a move was accepted with a forged permit; after: {', '.join(w.done)}")


def _unpublished(w: Watched, target: PlatformPose) -> bytes:
    return encode(w.rig.plan_to(target))


def _repeat_old(w: Watched) -> None:
    if w.old_commands:
        try:
            w.rig.ask(w.rig.random.choice(w.old_commands))
        except NoReply:
            return


def _stop(w: Watched) -> None:
    try:
        w.rig.stop()
    except NoReply:
        return


def _inject(w: Watched) -> None:
    fault = w.rig.random.choice(list(Fault))
    w.done.append(f"+{fault.value}")
    w.faults.add(fault)
    w.rig.virtual.inject(fault)


def _mend(w: Watched) -> None:
    for fault in sorted(w.faults)[: w.rig.random.randint(1, 3)]:
        w.faults.discard(fault)
        w.rig.virtual.clear(fault)
        w.unheard_since_move |= fault in UNHEARD


def _gateway_pauses(w: Watched) -> None:
    w.rig.gateway_alive = not w.rig.gateway_alive


def _gateway_restarts(w: Watched) -> None:
    w.rig.gateway_boot += "1"
    w.rig.give_signs_of_life()


def _registration_pauses(w: Watched) -> None:
    w.rig.registration_alive = not w.rig.registration_alive


def _new_image(w: Watched) -> None:
    w.rig.begin_epoch()


def _case_changes(w: Watched) -> None:
    w.rig.case_revision += 1
    w.rig.open_case()


def _link_flips(w: Watched) -> None:
    w.rig.bus.up = not w.rig.bus.up


def _stop_and_time(w: Watched) -> None:
    _stop(w)
    w.tick(w.rig.random.uniform(0.0, 0.5))


EVENTS_BY_WEIGHT: dict[Callable[[Watched], None], int] = {
    _sensible_step: 45,
    _inject: 14,
    _mend: 12,
    _repeat_old: 6,
    _move_forged: 5,
    _move: 4,
    _plan: 2,
    _stop: 3,
    _stop_and_time: 2,
    _gateway_pauses: 4,
    _gateway_restarts: 1,
    _registration_pauses: 3,
    _new_image: 2,
    _case_changes: 1,
    _link_flips: 3,
}

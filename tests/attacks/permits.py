"""The attacks on permits as a table: claimed, altered, forged, for something else, late, used before."""

from collections.abc import Callable
from typing import Final

from tests.attacks.attack import Attack, Record
from tests.attacks.commands import as_thief
from tests.attacks.permit_forgeries import (
    ANOTHER_SHA256,
    LONGER_THAN_A_PERMIT_LASTS_S,
    altered,
    claimed,
    executed,
    forged,
    forged_plan,
    late,
    of_another_key,
    permit_with,
    reference,
    rewritten,
    twice,
    unknown_plan,
    wire,
)
from tests.attacks.site import Site

_BUS_KEY: Final = "the gateway's key of the bus"
_OVERHEARD: Final = f"{_BUS_KEY}, and a permit that it signed"
_BOTH_KEYS: Final = f"{_BUS_KEY}, and its permit key"
_EVERY_KEY: Final = "the gateway's two keys, and registration's"


def _attack(name: str, attacker: str, attempt: str, code: str, run: Callable[[Site], str]) -> Attack:
    return Attack(name, attacker, attempt, code, Record("robot", code), run)


ATTACKS: Final = (
    _attack(
        "claimed approval",
        _BUS_KEY,
        "a move of version 1, which claims an approval",
        "permit_missing",
        as_thief(claimed),
    ),
    _attack("reference without a permit", _BUS_KEY, "ask for a reference", "permit_missing", as_thief(reference)),
    _attack("altered permit", _OVERHEARD, "change the approver in it", "permit_altered", as_thief(altered)),
    _attack(
        "rewritten permit",
        _OVERHEARD,
        "change the approver, and the hash with it",
        "permit_forged",
        as_thief(rewritten),
    ),
    _attack("forged permit", _BUS_KEY, "a signature of random bytes", "permit_forged", as_thief(forged)),
    _attack(
        "permit of another key",
        _BUS_KEY,
        "sign a permit with a key of their own",
        "permit_of_another_key",
        as_thief(of_another_key),
    ),
    _attack(
        "permit for another motion",
        _OVERHEARD,
        "move with a permit for a reference",
        "permit_for_another_motion",
        permit_with(motion="reference", plan_sha256=None, hole_ids=()),
    ),
    _attack(
        "permit of another boot",
        _OVERHEARD,
        "move with a permit of before a restart",
        "permit_of_another_boot",
        permit_with(robot_boot_epoch="0" * 16),
    ),
    _attack(
        "permit of another case",
        _OVERHEARD,
        "move with a permit of another case",
        "permit_of_another_case",
        permit_with(case_id="case-0"),
    ),
    _attack(
        "permit of another revision",
        _OVERHEARD,
        "move with a permit of before the set-up changed",
        "permit_of_another_revision",
        permit_with(case_revision=0),
    ),
    _attack(
        "permit for another plan",
        _OVERHEARD,
        "move with a permit for another plan",
        "permit_for_another_plan",
        permit_with(plan_sha256=ANOTHER_SHA256),
    ),
    _attack(
        "permit for other holes",
        _OVERHEARD,
        "move with a permit for another hole",
        "permit_for_other_holes",
        permit_with(hole_ids=("another",)),
    ),
    _attack(
        "permit from the future",
        _BOTH_KEYS,
        "a permit that quotes a state from the future",
        "permit_state_unknown",
        permit_with(after_state_sequence=10**9),
    ),
    _attack(
        "late permit",
        _OVERHEARD,
        f"hold it back for {LONGER_THAN_A_PERMIT_LASTS_S:g} s",
        "permit_expired",
        as_thief(late),
    ),
    _attack("used permit", _OVERHEARD, "use it a second time", "permit_used", as_thief(twice)),
    _attack(
        "permit without clearance",
        _OVERHEARD,
        "move with one that does not say that the bone is free",
        "permit_without_clearance",
        permit_with(nothing_inside=False),
    ),
    _attack(
        "unpublished plan",
        _BOTH_KEYS,
        "permit a plan that registration has not published",
        "plan_unknown",
        as_thief(unknown_plan),
    ),
    _attack(
        "forged plan",
        _EVERY_KEY,
        "publish the plan with its target 2 mm off, and permit it",
        "target_inconsistent",
        as_thief(forged_plan),
    ),
)

AFTER_THE_MOVE: Final = (
    _attack(
        "plan carried out again",
        _BOTH_KEYS,
        "permit the plan that was carried out once more",
        "plan_already_executed",
        as_thief(executed),
    ),
    _attack(
        "wire in the bone",
        _BOTH_KEYS,
        "permit a move although a wire is reported in place",
        "something_inside",
        as_thief(wire),
    ),
)

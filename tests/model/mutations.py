"""Seeded mutations: changes of the code that is searched, each of which breaks a property."""

from typing import Final

from tests.model.mutation import Mutation

_LATE: Final = "late, lost and repeated commands"
_FAILS: Final = "a controller that fails"
_WIRES: Final = "wires"
_WIRES_DISK: Final = "wires, and a full disk"
_WIRES_ROBOT: Final = "wires, and a robot service that ends"
_THIEF: Final = "another client"
_TABLE: Final = "services.robot.core.motion:_table"
_LEDGER: Final = "services.robot.core.envelope:CommandLedger"
_RULES: Final = "services.robot.core.permit_checks"
_COMMANDS: Final = "services.ui_api.handlers.commands:CommandHandler"
_OPERATIONS: Final = "services.ui_api.core.operations"

MUTATIONS: Final = (
    Mutation(
        "a stop locks, and no acknowledgement is needed",
        _TABLE,
        "(state, e.STOP): Transition(s.STOPPED, _STOP_AND_LOCK)",
        "(state, e.STOP): Transition(s.LOCKED, _STOP_AND_LOCK)",
        _LATE,
    ),
    Mutation(
        "a motion goes on when a stop comes",
        _TABLE,
        "table |= {(state, e.STOP): Transition(s.STOPPED, _STOP_AND_LOCK) for state in _STOPPABLE}",
        "table |= {(state, e.STOP): Transition(state if state in _UNDER_WAY else s.STOPPED, _STOP_AND_LOCK)"
        " for state in _STOPPABLE}",
        _LATE,
    ),
    Mutation(
        "the service starts with the stop released",
        _TABLE,
        "(s.DISCONNECTED, e.CONNECTED): Transition(s.STOPPED, (Effect.LOCK,))",
        "(s.DISCONNECTED, e.CONNECTED): Transition(s.UNREFERENCED, (Effect.LOCK, Effect.RELEASE_STOP))",
        _LATE,
    ),
    Mutation(
        "a lost gateway releases the stop",
        _TABLE,
        "(state, e.SUPERVISION_LOST): Transition(s.STOPPED, _STOP_AND_LOCK)",
        "(state, e.SUPERVISION_LOST): Transition(s.LOCKED, _STOP_AND_LOCK)",
        _LATE,
    ),
    Mutation(
        "an acknowledgement leaves the stop in force",
        _TABLE,
        "(s.STOPPED, e.ACKNOWLEDGE_REFERENCED): Transition(s.LOCKED, (Effect.LOCK, Effect.RELEASE_STOP))",
        "(s.STOPPED, e.ACKNOWLEDGE_REFERENCED): Transition(s.STOPPED, (Effect.LOCK,))",
        _LATE,
    ),
    Mutation(
        "a reset leaves a fault as it is",
        _TABLE,
        "(s.FAULT, e.RESET): Transition(s.DISCONNECTED, (*_STOP_AND_LOCK, Effect.DISCONNECT))",
        "(s.FAULT, e.RESET): Transition(s.FAULT)",
        _FAILS,
    ),
    Mutation(
        "a reference never ends",
        _TABLE,
        "(s.REFERENCING, e.REFERENCE_DONE): Transition(s.LOCKED, (Effect.LOCK,))",
        "(s.REFERENCING, e.REFERENCE_DONE): Transition(s.REFERENCING)",
        _LATE,
    ),
    Mutation(
        "commands of another boot are taken",
        f"{_LEDGER}._refusal",
        "if envelope.robot_boot_epoch != self.boot_epoch:",
        "if False:",
        _WIRES_ROBOT,
    ),
    Mutation(
        "commands do not expire",
        f"{_LEDGER}._lateness",
        "now_s - published_s <= envelope.time_to_live_s",
        "now_s >= published_s",
        _LATE,
    ),
    Mutation(
        "commands from before a stop are taken",
        f"{_LEDGER}._stopped_since",
        "quoted >= self._first_since_stop",
        "quoted >= 0",
        _LATE,
    ),
    Mutation(
        "stops are not counted",
        "services.robot.core.status:DriveStatus.after_transition",
        "stops=self.stops + int(stop_is_latched(state))",
        "stops=self.stops",
        _LATE,
    ),
    Mutation("permits do not expire", f"{_RULES}:_expired", "not has_expired(published_s, now.now_s)", "True", _THIEF),
    Mutation(
        "permits from before a stop are taken",
        f"{_RULES}:_before_stop",
        "permit.after_state_sequence >= now.first_since_stop",
        "True",
        _THIEF,
    ),
    Mutation(
        "permits are taken again",
        f"{_RULES}:_used",
        "if now.used.holds(permit.nonce) else None",
        "if False else None",
        _THIEF,
    ),
    Mutation(
        "nonces are not recorded",
        "services.robot.core.permits:UsedPermits.with_taken",
        "(*alive, (nonce, quoted_published_s))",
        "alive",
        _THIEF,
    ),
    Mutation(
        "commands are handed over before they are on record",
        f"{_COMMANDS}._begin",
        "unit.after_commit(lambda: self._hand_over(waiting))",
        "self._hand_over(waiting)",
        _WIRES_DISK,
    ),
    Mutation(
        "forged signatures are taken",
        "shared.pki.permit_key:PermitVerifier.has_signed",
        "return False",
        "return True",
        _THIEF,
    ),
    Mutation(
        "steps are recorded while a reference is pending",
        "services.ui_api.handlers.procedure:ProcedureHandler._pending",
        "if verb in VERBS_WITH_A_MOTION:",
        "if False:",
        _WIRES,
    ),
    Mutation(
        "wires do not count",
        "services.ui_api.core.ledger:Ledger.inside",
        "return () if newest is None else",
        "return () if newest is not None else",
        _WIRES,
    ),
    Mutation(
        "a command is given up before it expires",
        f"{_OPERATIONS}:_too_late",
        "saying.clock_s - requested.state_clock_s > requested.time_to_live_s + _SETTLING_S",
        "saying.clock_s >= requested.state_clock_s",
        _LATE,
    ),
    Mutation(
        "a new run of the robot service ends what is pending before its controller was stopped",
        f"{_OPERATIONS}:settle",
        "_robot_restarted(operation) if saying.connected else None",
        "_robot_restarted(operation)",
        _WIRES_ROBOT,
    ),
    Mutation(
        "a command that brings no answer counts as not carried out",
        f"{_COMMANDS}._ask_robot",
        "return OperationProgressed(waiting.operation_id, OperationStatus.UNKNOWN, message)\n    if reply.verdict == "
        '"refused" and',
        "return _never_began(waiting, OperationStatus.FAILED, 'no_answer', message)\n    if reply.verdict == "
        '"refused" and',
        _LATE,
    ),
)

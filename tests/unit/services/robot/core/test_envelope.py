"""At most once and never late: every refusal of the command ledger."""

from dataclasses import replace

import pytest

from services.robot.core import envelope as module
from services.robot.core.envelope import Admitted, CommandLedger, Envelope, Repeat
from services.robot.core.refusals import Refusal, RefusalCode

ENVELOPE = Envelope("c1", "gateway", 1, "boot", 7, 1.0, "move abc")
PUBLISHED_S = 100.0


@pytest.fixture
def ledger() -> CommandLedger:
    ledger = CommandLedger("boot")
    ledger.note_published(7, PUBLISHED_S, stops=0)
    return ledger


def code_of(outcome: object) -> RefusalCode:
    assert isinstance(outcome, Refusal)
    return outcome.code


def test_a_command_in_time_is_admitted_once_and_its_repeat_gets_the_same_answer(ledger: CommandLedger) -> None:
    assert ledger.admit(ENVELOPE, PUBLISHED_S + 0.9, stops=0) == Admitted()
    ledger.answered("c1", b"yes")
    assert ledger.admit(ENVELOPE, PUBLISHED_S + 500.0, stops=0) == Repeat(b"yes")


def test_a_repeat_while_the_command_is_being_decided_is_not_admitted(ledger: CommandLedger) -> None:
    ledger.admit(ENVELOPE, PUBLISHED_S, stops=0)
    assert code_of(ledger.admit(ENVELOPE, PUBLISHED_S, stops=0)) is RefusalCode.OUTCOME_UNKNOWN


def test_an_id_used_again_for_another_effect_is_refused(ledger: CommandLedger) -> None:
    ledger.admit(ENVELOPE, PUBLISHED_S, stops=0)
    ledger.answered("c1", b"yes")
    other = replace(ENVELOPE, client_sequence=2, effect="move def")
    assert code_of(ledger.admit(other, PUBLISHED_S, stops=0)) is RefusalCode.COMMAND_ID_REUSED


def test_a_late_command_is_refused_with_its_age_and_limit(ledger: CommandLedger) -> None:
    outcome = ledger.admit(ENVELOPE, PUBLISHED_S + 3.5, stops=0)
    assert code_of(outcome) is RefusalCode.COMMAND_EXPIRED
    assert isinstance(outcome, Refusal)
    assert "state 7, which is 3.50 s old, its time to live is 1 s" in outcome.message


def test_a_state_out_of_record_counts_as_late(ledger: CommandLedger) -> None:
    for sequence in range(8, 8 + module.REMEMBERED_STATES):
        ledger.note_published(sequence, PUBLISHED_S, stops=0)
    assert code_of(ledger.admit(ENVELOPE, PUBLISHED_S, stops=0)) is RefusalCode.COMMAND_EXPIRED


@pytest.mark.parametrize("sequence", [8, 10**9])
def test_a_state_that_was_never_published_is_refused(ledger: CommandLedger, sequence: int) -> None:
    outcome = ledger.admit(replace(ENVELOPE, after_state_sequence=sequence), PUBLISHED_S, stops=0)
    assert code_of(outcome) is RefusalCode.STATE_NOT_PUBLISHED


def test_before_the_first_state_nothing_is_admitted() -> None:
    assert code_of(CommandLedger("boot").admit(ENVELOPE, 0.0, stops=0)) is RefusalCode.STATE_NOT_PUBLISHED


@pytest.mark.requirement("ROB-10")
def test_another_boot_is_refused(ledger: CommandLedger) -> None:
    outcome = ledger.admit(replace(ENVELOPE, robot_boot_epoch="before"), PUBLISHED_S, stops=0)
    assert code_of(outcome) is RefusalCode.WRONG_BOOT_EPOCH


@pytest.mark.requirement("ROB-10")
@pytest.mark.parametrize("sequence", [0, 1])
def test_commands_out_of_order_are_refused_per_client(ledger: CommandLedger, sequence: int) -> None:
    ledger.admit(ENVELOPE, PUBLISHED_S, stops=0)
    late = replace(ENVELOPE, command_id="c2", client_sequence=sequence)
    assert code_of(ledger.admit(late, PUBLISHED_S, stops=0)) is RefusalCode.COMMAND_OUT_OF_ORDER
    assert ledger.admit(replace(late, client="console"), PUBLISHED_S, stops=0) == Admitted()


def test_a_refused_command_leaves_no_trace(ledger: CommandLedger) -> None:
    ledger.admit(replace(ENVELOPE, robot_boot_epoch="before"), PUBLISHED_S, stops=0)
    assert ledger.admit(ENVELOPE, PUBLISHED_S, stops=0) == Admitted()


def test_a_command_that_fell_out_of_the_record_is_out_of_order_and_late(ledger: CommandLedger) -> None:
    ledger.admit(ENVELOPE, PUBLISHED_S, stops=0)
    for number in range(2, module.REMEMBERED_COMMANDS + 3):
        other = replace(ENVELOPE, command_id=f"c{number}", client_sequence=number)
        assert ledger.admit(other, PUBLISHED_S, stops=0) == Admitted()
    assert code_of(ledger.admit(ENVELOPE, PUBLISHED_S, stops=0)) is RefusalCode.COMMAND_OUT_OF_ORDER


def test_a_forgotten_client_cannot_bring_an_old_command_in_late(ledger: CommandLedger) -> None:
    ledger.admit(ENVELOPE, PUBLISHED_S, stops=0)
    for number in range(module.REMEMBERED_CLIENTS + 1):
        ledger.admit(replace(ENVELOPE, command_id=f"d{number}", client=f"client{number}"), PUBLISHED_S, stops=0)
    replay = replace(ENVELOPE, command_id="replay")
    assert code_of(ledger.admit(replay, PUBLISHED_S + 2.0, stops=0)) is RefusalCode.COMMAND_EXPIRED


@pytest.mark.requirement("ROB-05")
def test_a_command_asked_for_before_a_stop_is_not_carried_out_after_it(ledger: CommandLedger) -> None:
    outcome = ledger.admit(ENVELOPE, PUBLISHED_S, stops=1)
    assert code_of(outcome) is RefusalCode.STOPPED_SINCE, "the stop has not even been published"
    ledger.note_published(8, PUBLISHED_S, stops=1)
    assert code_of(ledger.admit(ENVELOPE, PUBLISHED_S, stops=1)) is RefusalCode.STOPPED_SINCE
    assert ledger.admit(replace(ENVELOPE, after_state_sequence=8), PUBLISHED_S, stops=1) == Admitted()


def test_states_published_between_two_stops_can_be_quoted_until_the_second(ledger: CommandLedger) -> None:
    for sequence in (8, 9):
        ledger.note_published(sequence, PUBLISHED_S, stops=1)
    quoting_the_first = replace(ENVELOPE, after_state_sequence=8)
    assert ledger.admit(quoting_the_first, PUBLISHED_S, stops=1) == Admitted()
    ledger.note_published(10, PUBLISHED_S, stops=2)
    later = replace(quoting_the_first, command_id="c2", client_sequence=2)
    assert code_of(ledger.admit(later, PUBLISHED_S, stops=2)) is RefusalCode.STOPPED_SINCE

"""A part of the robot's benchmarks of faults, noise and delivery: nothing may go wrong even once."""

import pytest

from benchmarks.robot import delivery, faults, noise

pytestmark = [pytest.mark.slow, pytest.mark.long, pytest.mark.timeout(900)]


def test_no_sequence_of_faults_leads_to_an_unpermitted_motion_or_ends_unlocked() -> None:
    seeds = range(20_000, 20_000 + faults.SEQUENCES // 400)
    results = faults.results(seeds)
    print(f"seeds {seeds}: {sum(r.moves for r in results)} moves")
    assert [r for r in results if r.wrong] == []
    assert sum(r.moves for r in results) > 20  # measured: 31
    assert {r.final_state for r in results} == {"stopped", "fault"}


# measured: 5 of 500 moves with one byte in a hundred wrong, 181 of 250 with one in a thousand: a busy machine adds some
@pytest.mark.parametrize(("wrong_share", "blocks", "right"), [(0.01, 2, 0), (0.001, 1, 118)])
def test_on_a_noisy_line_every_move_is_right_or_refused(wrong_share: float, blocks: int, right: int) -> None:
    seeds = range(900, 900 + blocks)
    total = noise.total_of(noise.run_block(seed, wrong_share) for seed in seeds)
    print(f"seeds {seeds}: {total}")
    assert total.wrong == ()
    assert total.right + total.refused == total.commands
    assert total.right > right
    assert total.refused > 0


def test_commands_take_effect_at_most_once_and_never_late() -> None:
    seeds = range(700, 702)
    total = delivery.total_of(delivery.run_rig(seed) for seed in seeds)
    print(f"seeds {seeds}: {total}")
    assert total.commands == len(seeds) * delivery.COMMANDS_PER_RIG
    assert (total.late, total.doubled) == (0, 0)
    assert total.moves > 60  # measured: 91
    assert {"command_expired", "command_out_of_order", "wrong_boot_epoch"} <= set(total.refusals)

"""Results that are kept for a session: made once for the same arguments, never shared."""

from pathlib import Path

import pytest

from tests.kept import kept


@pytest.fixture
def calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Arguments of all calls so far; the session's folder is a new one."""
    monkeypatch.setenv("TEST_RESULTS_KEPT", str(tmp_path))
    made.clear()
    return made


made: list[int] = []


@kept
def powers(base: int, highest: int = 3) -> list[int]:
    made.append(base)
    return [base**k for k in range(highest + 1)]


def test_the_same_arguments_are_asked_once(calls: list[int]) -> None:
    assert powers(2) == powers(2) == [1, 2, 4, 8]
    assert powers(3) == [1, 3, 9, 27]
    assert powers(2, highest=1) == [1, 2]
    assert calls == [2, 3, 2]


def test_every_caller_gets_a_copy(calls: list[int]) -> None:
    powers(2).clear()
    assert powers(2) == [1, 2, 4, 8]
    assert calls == [2]


def test_what_failed_is_tried_again(calls: list[int]) -> None:
    for _ in range(2):
        with pytest.raises(TypeError, match="unsupported operand"):
            powers("a")  # type: ignore[arg-type]  # the point of the test
    assert len(calls) == 2


def test_outside_a_session_nothing_is_kept(calls: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TEST_RESULTS_KEPT")
    assert powers(2) == powers(2)
    assert calls == [2, 2]

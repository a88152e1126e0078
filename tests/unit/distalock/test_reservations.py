"""What only one installation on a machine may use."""

from pathlib import Path

import pytest

from distalock.reservations import reserved
from shared.errors import ConfigurationError


def test_what_is_reserved_is_refused_to_others_and_free_again_afterwards(tmp_path: Path) -> None:
    with (
        reserved({"port 1": "", "port 2": ""}, tmp_path),
        pytest.raises(ConfigurationError, match="port 2 is used by another installation that runs now; choose 3"),
        reserved({"port 3": "", "port 2": "choose 3"}, tmp_path),
    ):
        pytest.fail("had what another has")
    with reserved({"port 2": "", "port 3": ""}, tmp_path):
        pass


def test_one_refusal_reserves_nothing(tmp_path: Path) -> None:
    with reserved({"port 2": ""}, tmp_path):
        with pytest.raises(ConfigurationError), reserved({"port 1": "", "port 2": ""}, tmp_path):
            pytest.fail("had what another has")
        with reserved({"port 1": ""}, tmp_path):
            pass


def test_a_folder_that_cannot_be_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with (
        pytest.raises(ConfigurationError, match=r"port 1 cannot be reserved in .*file.* \(.+\); see to that folder"),
        reserved({"port 1": ""}, tmp_path / "file" / "folder"),
    ):
        pytest.fail("had what cannot be")

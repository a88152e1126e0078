"""A version is made of what is committed: its number follows, and the changelog says what it is."""

from datetime import date
from pathlib import Path

import pytest

from shared.errors import ConfigurationError
from tools.version import keep_schemas, main, with_release, with_version

PYPROJECT = '[project]\nname = "distalock"\nversion = "0.2.0"\n'
DAY = date(2026, 3, 4)


def test_what_was_unreleased_gets_the_number_and_the_date() -> None:
    text = with_release("# Changelog\n\n## Unreleased\n- New.\n\n## 0.1.0 - 2026-01-01\n- Old.\n", "0.2.0", DAY)
    assert text == "# Changelog\n\n## Unreleased\n\n## 0.2.0 - 2026-03-04\n- New.\n\n## 0.1.0 - 2026-01-01\n- Old.\n"


def test_the_first_version_follows_nothing() -> None:
    assert with_release("# Changelog\n\n## Unreleased\n- New.\n", "0.1.0", DAY).endswith(
        "## 0.1.0 - 2026-03-04\n- New.\n"
    )


@pytest.mark.parametrize("text", ["# Changelog\n", "# Changelog\n\n## Unreleased\n\n## 0.1.0 - 2026-01-01\n- Old.\n"])
def test_a_version_without_a_change_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match="has nothing under '## Unreleased'"):
        with_release(text, "0.2.0", DAY)


def test_a_later_number_follows_and_the_same_one_only_before_its_release() -> None:
    assert 'version = "0.2.1"' in with_version(PYPROJECT, "0.2.1", tagged=True)
    assert with_version(PYPROJECT, "0.2.0", tagged=False) == PYPROJECT
    for version, tagged in (("0.2.0", True), ("0.1.9", False)):
        with pytest.raises(ConfigurationError, match=r"does not follow 0\.2\.0"):
            with_version(PYPROJECT, version, tagged=tagged)


@pytest.mark.parametrize("version", ["1", "0.2", "v0.2.0", "0.2.0rc1", ""])
def test_what_is_no_number_is_refused(version: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ConfigurationError, match="is no version; three numbers are needed"):
        with_version(PYPROJECT, version, tagged=False)


def test_a_checkout_with_changes_makes_no_version(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tools.version.revision", lambda: "abc+")
    assert main(["9.0.0"]) == 2
    assert "commit what was changed" in capsys.readouterr().err


def test_schemas_of_a_release_replace_those_that_were_kept(tmp_path: Path) -> None:
    (tmp_path / "0.2.0").mkdir()
    (tmp_path / "0.2.0" / "gone-1.json").write_text("{}")
    keep_schemas(tmp_path / "0.2.0")
    assert {"robot-state-1.json", "nail-1.json"} <= {file.name for file in (tmp_path / "0.2.0").iterdir()}
    assert not (tmp_path / "0.2.0" / "gone-1.json").exists()

"""Settings of the robot service."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from services.robot.core.deviation import Deviation
from services.robot.core.tuning import SUPERVISION
from services.robot.devices.controller import Encoders
from services.robot.settings import RobotSettings
from shared.errors import ConfigurationError
from shared.parts.hexapod_file import DEFAULT_HEXAPOD
from shared.pki.keystore import Keystore
from shared.runtime.settings import load_settings


def test_defaults_are_the_shipped_robot_and_the_limits_of_the_safety_page() -> None:
    settings = load_settings(RobotSettings)
    assert settings.hexapod_file == DEFAULT_HEXAPOD
    limits = settings.guard_limits()
    assert limits.step == Deviation(20.0, 12.0)
    assert (limits.plan_lifetime_s, limits.heartbeat_deadline_s) == (600.0, 0.2)


def test_only_incremental_encoders_may_move_for_reference() -> None:
    assert load_settings(RobotSettings).reference_travel() == SUPERVISION.read_back
    assert load_settings(RobotSettings, encoders=Encoders.INCREMENTAL).reference_travel().distance_mm > 10.0


@pytest.mark.parametrize(
    ("name", "value"),
    [("heartbeat_deadline_s", 0.6), ("largest_step_mm", 41.0), ("encoders", "none"), ("reply_timeout_s", 0.0)],
)
def test_settings_that_would_weaken_the_guard_are_refused(name: str, value: object) -> None:
    with pytest.raises(ConfigurationError, match=f"setting '{name}'"):
        load_settings(RobotSettings, **{name: value})


def test_the_key_of_permits_is_where_the_state_folder_has_it_or_the_settings_say(tmp_path: Path) -> None:
    settings = load_settings(RobotSettings, state_dir=tmp_path)
    with pytest.raises(ConfigurationError, match=r"pki/robot/permit_certificate\.pem is missing"):
        settings.permit_verifier()
    Keystore(tmp_path / "pki").ensure(datetime.now(UTC))
    made = settings.permit_verifier().key_sha256
    folder = tmp_path / "pki" / "robot"
    named = load_settings(
        RobotSettings,
        state_dir=tmp_path / "elsewhere",
        permit_certificate=folder / "permit_certificate.pem",
        tls_authority=folder / "authority.pem",
    )
    assert named.permit_verifier().key_sha256 == made


def test_paths_are_paths() -> None:
    assert isinstance(load_settings(RobotSettings, hexapod_file="x.json").hexapod_file, Path)

"""A tenth of `distalock bench hexapod_kinematics`; the speed only against its peer."""

from benchmarks.robot.hexapod_kinematics import POSES, SEED, inverse_speed, round_trip
from shared.parts.hexapod_file import default_hexapod


def test_inverse_then_forward_returns_every_pose() -> None:
    trip = round_trip(default_hexapod(), SEED + 1, POSES // 10)
    print(f"seed {SEED + 1}: {trip}")
    assert trip.poses == POSES // 10
    # measured: 2.8e-13 mm and 5.0e-15 rad
    assert trip.worst_mm < 4.3e-13
    assert trip.worst_rad < 7.5e-15


def test_the_inverse_is_faster_than_plain_numpy() -> None:
    speed = inverse_speed(default_hexapod(), SEED, 50_000)
    print(speed)
    assert speed.ours_per_s > speed.plain_per_s

"""Numbers of the hexapod's kinematics, for the console's tests: `hexapod.fixture.json` beside its `hexapod.ts`.

The console computes legs and the guide's place by itself, to draw them; these numbers hold it to `shared/geometry`.
"""

import json
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top, leg_lengths_mm
from shared.geometry.hexapod_limits import joint_angles_deg, straight_path
from shared.parts.catalogue import DEFAULT_HEXAPOD
from shared.parts.hexapod_file import hexapod_from_json

FIXTURE: Final = Path(__file__).parents[1] / "services/ui_api/console/src/scene/hexapod.fixture.json"
_DIGITS: Final = 6
_SEED: Final = 55
_POSES: Final = 12
# Beyond the limits too: the console must show by how much a pose is outside.
_REACH: Final = np.array([15.0, 15.0, 10.0, 20.0, 20.0, 25.0])
_HEAD_EXTENSIONS_MM: Final = (40.0, 60.0, 72.5)


def fixture_text() -> str:
    """The fixture's content."""
    hexapod = hexapod_from_json(DEFAULT_HEXAPOD.read_bytes(), DEFAULT_HEXAPOD.name)
    rng = np.random.default_rng(_SEED)
    poses = [np.zeros(6), *(rng.uniform(-1.0, 1.0, (_POSES, 6)) * _REACH)]
    pivots = [hexapod.pivot_mm, np.zeros(3), np.array([57.5, -3.25, 21.0])]
    extensions = _HEAD_EXTENSIONS_MM
    cases = [
        _case(hexapod, pose.round(4), pivots[i % len(pivots)], extensions[i % len(extensions)])
        for i, pose in enumerate(poses)
    ]
    fixture = {
        "made_by": "make generated, from shared/geometry/hexapod.py",
        "hexapod": json.loads(DEFAULT_HEXAPOD.read_text(encoding="utf-8")),
        "cases": cases,
        "path": _path(poses[1].round(4), poses[2].round(4)),
    }
    return json.dumps(fixture, indent=1) + "\n"


def _case(
    hexapod: HexapodPart, pose: NDArray[np.float64], pivot_mm: NDArray[np.float64], head_extension_mm: float
) -> dict[str, object]:
    top = base_from_top(hexapod, PlatformPose.from_array(pose), pivot_mm)
    at_base, at_top = joint_angles_deg(hexapod, pose, pivot_mm)
    return {
        "pose": _pose(pose),
        "pivot_mm": pivot_mm.tolist(),
        "head_extension_mm": head_extension_mm,
        "leg_lengths_mm": _numbers(leg_lengths_mm(hexapod, pose, pivot_mm)),
        "base_angles_deg": _numbers(at_base),
        "top_angles_deg": _numbers(at_top),
        "base_from_guide": _numbers((top @ hexapod.top_from_guide(head_extension_mm)).matrix),
    }


def _path(start: NDArray[np.float64], end: NDArray[np.float64]) -> dict[str, object]:
    """A straight move, and the pose in the middle of it."""
    path = straight_path(PlatformPose.from_array(start), PlatformPose.from_array(end))
    at = len(path) // 3
    return {
        "start": _pose(start),
        "target": _pose(end),
        "share": at / (len(path) - 1),
        "pose": _pose(path[at].round(_DIGITS)),
    }


def _pose(values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip(("x_mm", "y_mm", "z_mm", "u_deg", "v_deg", "w_deg"), values.tolist(), strict=True))


def _numbers(values: NDArray[np.float64]) -> object:
    # A sum of zeros of either sign would differ between machines.
    return (np.round(values, _DIGITS) + 0.0).tolist()

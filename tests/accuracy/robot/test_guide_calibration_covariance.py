"""The covariance of a guide calibration against the true errors of simulated ones."""

import numpy as np

from benchmarks.robot.guide_calibration import calibration_poses, result_of
from benchmarks.robot.guide_rooms import made_head, numerical_views
from shared.parts.hexapod_file import default_hexapod

HEXAPOD = default_hexapod()


def test_with_noise_the_covariance_is_honest() -> None:
    heads = {seed: made_head(HEXAPOD, seed) for seed in range(640, 652)}
    results = [result_of(HEXAPOD, h, numerical_views(HEXAPOD, h, calibration_poses(), s), s) for s, h in heads.items()]
    for result in results:
        print(result)
    normalised = float(np.mean([r.normalised for r in results]))
    assert 0.6 < normalised < 1.5
    assert np.median([r.error_mm for r in results]) < 0.1
    assert np.median([r.error_deg for r in results]) < 0.1

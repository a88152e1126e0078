"""Pick a femur and a thigh."""

import numpy as np

from simulation.scenario.files import AnatomyRanges
from simulation.scenario.values import Anatomy, Side


def sample_anatomy(ranges: AnatomyRanges, side: Side, generator: np.random.Generator) -> Anatomy:
    """Pick a femur and a thigh; the two condyles differ a little, as they do."""
    g = generator
    flare_start = g.uniform(*ranges.flare_start_mm)
    condyles = [
        (g.uniform(*ranges.condyle_length_mm), g.uniform(*ranges.condyle_depth_mm), g.uniform(*ranges.condyle_width_mm))
        for _ in range(2)
    ]
    return Anatomy(
        posterior_y=1.0 if side is Side.RIGHT else -1.0,
        shaft_half_axes_mm=(g.uniform(*ranges.shaft_half_axis_mm), g.uniform(*ranges.shaft_half_axis_mm)),
        flare_half_axes_mm=(g.uniform(*ranges.flare_front_back_mm), g.uniform(*ranges.flare_side_mm)),
        flare_from_to_mm=(flare_start, flare_start + g.uniform(*ranges.flare_length_mm)),
        cortex_shaft_mm=g.uniform(*ranges.cortex_shaft_mm),
        cortex_end_mm=g.uniform(*ranges.cortex_end_mm),
        condyle_centre_x_mm=(g.uniform(*ranges.condyle_centre_x_mm), g.uniform(*ranges.condyle_centre_x_mm)),
        condyle_back_mm=(g.uniform(*ranges.condyle_back_mm), g.uniform(*ranges.condyle_back_mm)),
        condyle_half_axes_mm=(condyles[0], condyles[1]),
        condyle_spread_mm=g.uniform(*ranges.condyle_spread_mm),
        spongy_share=g.uniform(*ranges.spongy_share),
        texture_contrast=g.uniform(*ranges.texture_contrast),
        texture_seed=int(g.integers(2**31)),
        thigh_half_axes_mm=(g.uniform(*ranges.thigh_front_back_mm), g.uniform(*ranges.thigh_side_mm)),
        thigh_centre_mm=(g.uniform(*ranges.thigh_offset_mm), g.uniform(*ranges.thigh_offset_mm)),
    )

"""Pick a bone and the limb around it."""

import numpy as np

from simulation.scenario.files import AnatomyRanges, CondyleRanges
from simulation.scenario.values import Anatomy, Side


def sample_anatomy(ranges: AnatomyRanges, drilled_from: Side, generator: np.random.Generator) -> Anatomy:
    """Pick a bone and a limb; the two condyles differ a little, as they do, or are of ranges of their own."""
    g = generator
    flare_start = g.uniform(*ranges.flare_start_mm)
    near = CondyleRanges(
        centre_x_mm=ranges.condyle_centre_x_mm,
        back_mm=ranges.condyle_back_mm,
        length_mm=ranges.condyle_length_mm,
        depth_mm=ranges.condyle_depth_mm,
        width_mm=ranges.condyle_width_mm,
    )
    far = ranges.far_condyle or near
    condyles = [(g.uniform(*one.length_mm), g.uniform(*one.depth_mm), g.uniform(*one.width_mm)) for one in (near, far)]
    return Anatomy(
        posterior_y=1.0 if drilled_from is Side.RIGHT else -1.0,
        shaft_half_axes_mm=(g.uniform(*ranges.shaft_half_axis_mm), g.uniform(*ranges.shaft_half_axis_mm)),
        flare_half_axes_mm=(g.uniform(*ranges.flare_front_back_mm), g.uniform(*ranges.flare_side_mm)),
        flare_from_to_mm=(flare_start, flare_start + g.uniform(*ranges.flare_length_mm)),
        cortex_shaft_mm=g.uniform(*ranges.cortex_shaft_mm),
        cortex_end_mm=g.uniform(*ranges.cortex_end_mm),
        condyle_centre_x_mm=(g.uniform(*near.centre_x_mm), g.uniform(*far.centre_x_mm)),
        condyle_back_mm=(g.uniform(*near.back_mm), g.uniform(*far.back_mm)),
        condyle_half_axes_mm=(condyles[0], condyles[1]),
        condyle_spread_mm=g.uniform(*ranges.condyle_spread_mm),
        spongy_share=g.uniform(*ranges.spongy_share),
        texture_contrast=g.uniform(*ranges.texture_contrast),
        texture_seed=int(g.integers(2**31)),
        thigh_half_axes_mm=(g.uniform(*ranges.thigh_front_back_mm), g.uniform(*ranges.thigh_side_mm)),
        thigh_centre_mm=(g.uniform(*ranges.thigh_offset_mm), g.uniform(*ranges.thigh_offset_mm)),
    )

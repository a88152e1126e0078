"""Every tuned value of imaging and of its measurements declares where it comes from."""

import pytest

from services.imaging.core import tuning as imaging
from shared.tuning import values_of
from shared.xray import tuning as xray

GROUPS = (*imaging.SETTINGS, *xray.SETTINGS)


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: type(group).__name__)
def test_values_have_unit_effect_and_provenance(group: object) -> None:
    for value in values_of(group):
        assert value.unit
        assert value.effect
        assert value.origin.source

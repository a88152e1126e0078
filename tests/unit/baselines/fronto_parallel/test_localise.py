"""The fronto-parallel method finds axes, and is rejected because it estimates no errors."""

from baselines.fronto_parallel.localise import localise_fronto_parallel
from shared.errors import ReasonCode
from tests.unit.services.registration.rendered_case import Shown, rendered, rendered_parts, turned_nail


def test_the_method_reports_axes_and_is_rejected() -> None:
    pixels, view = rendered(Shown(nail=turned_nail((0.3, 0.2))), seed=6)
    result = localise_fronto_parallel(pixels, view, rendered_parts())
    assert {reason.code for reason in result.reasons} == {ReasonCode.UNCERTAINTY_TOO_LARGE}
    assert result.holes is not None
    assert all(hole.offset is None for hole in result.holes)

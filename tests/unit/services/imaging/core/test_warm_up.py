"""What is compiled before the first image."""

from services.imaging.core.motion_blur import _moments
from services.imaging.core.seeds import _counted
from services.imaging.core.warm_up import compile_core
from shared.xray.disc_residuals import darkest_spot
from shared.xray.patch_fit import fit_each, fit_patch


def test_every_compiled_function_that_images_go_through_is_compiled() -> None:
    compile_core()
    for function in (_moments, _counted, darkest_spot, fit_each, fit_patch):
        assert function.signatures, function

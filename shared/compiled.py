"""Inner loops over pixels, rays and balls are compiled, everything else is numpy.

Numba compiles them, or a library made beforehand holds their machine code, where one is installed: in the images of
services, which have no compiler.
"""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Final, ParamSpec, TypeVar, cast

from shared.kernel_library import KernelLibrary, Kernels, installed_library, missing, name_of

P = ParamSpec("P")
R = TypeVar("R")

_LIBRARY: Final[KernelLibrary | None] = installed_library()
_HAS_NUMBA: Final = find_spec("numba") is not None


def load_kernels() -> Kernels:
    """Have the machine code of every kernel that this process has imported, so that no first image waits for it.

    What was compiled for another processor is compiled for this one. A kernel that was never called is left to its
    first call: `python -m distalock.prepare` calls all of them. Raises `ConfigurationError` where machine code was made
    for others than this processor and there is no compiler.
    """
    if _LIBRARY is not None:
        return _LIBRARY.checked()
    from shared.just_in_time import load_from_disk  # only where there is no library

    return load_from_disk()


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function to machine code on first use and keep the result on disk, beside the source."""
    return _compiled(function)


def compiled_fast(function: Callable[P, R]) -> Callable[P, R]:
    """The same, with sums in whatever order is fastest; no value may be infinite or not a number."""
    return _compiled(function, fastmath=True)


def compiled_inline(function: Callable[P, R]) -> Callable[P, R]:
    """The same; the function becomes part of every compiled function that calls it, and is called by no other.

    Loops over rays call dozens of small functions with many arguments: calls and counted references to arrays take
    more than half of their time otherwise.
    """
    return _compiled(function, forceinline=True)


def _compiled(function: Callable[P, R], *, fastmath: bool = False, forceinline: bool = False) -> Callable[P, R]:
    if _LIBRARY is not None:
        return cast("Callable[P, R]", _LIBRARY.kernel(function))
    if not _HAS_NUMBA:
        return cast("Callable[P, R]", missing(name_of(function), "neither numba nor a library of kernels is installed"))
    from shared.just_in_time import compiled_by_numba  # only where there is no library

    return cast("Callable[P, R]", compiled_by_numba(function, fastmath=fastmath, forceinline=forceinline))

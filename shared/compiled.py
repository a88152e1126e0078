"""Numba's compiler: inner loops over pixels, rays and balls are compiled, everything else is numpy."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numba
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys

P = ParamSpec("P")
R = TypeVar("R")


class _MachineCodeOnDisk(FunctionCache):
    """Numba's cache of machine code, read without preparing the compiler.

    Before it reads a file, numba's own cache loads the rules for lowering everything that it can compile. That takes
    a quarter of a second in each process, and machine code on disk does not need it. Without a file the compiler
    loads them itself.
    """

    def load_overload(self, sig: object, target_context: object) -> object:
        """Machine code for arguments of these types, or None."""
        rtsys.initialize(target_context)  # machine code counts its references to arrays with it
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]  # of numba


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function to machine code on first use and keep the result on disk, beside the source."""
    return _compiled(function)


def compiled_fast(function: Callable[P, R]) -> Callable[P, R]:
    """The same, with sums in whatever order is fastest; no value may be infinite or not a number."""
    return _compiled(function, fastmath=True)


def compiled_inline(function: Callable[P, R]) -> Callable[P, R]:
    """The same; the function becomes part of every compiled function that calls it.

    Loops over rays call dozens of small functions with many arguments: calls and counted references to arrays take
    more than half of their time otherwise.
    """
    return _compiled(function, forceinline=True)


def _compiled(function: Callable[P, R], *, fastmath: bool = False, forceinline: bool = False) -> Callable[P, R]:
    decorated = numba.njit(error_model="numpy", nogil=True, fastmath=fastmath, forceinline=forceinline)
    dispatcher = decorated(function)
    # as `cache=True` does with numba's own cache
    dispatcher._cache = _MachineCodeOnDisk(function)  # type: ignore[attr-defined, no-untyped-call]
    machine_code: Callable[P, R] = dispatcher
    return machine_code

"""Numba's compiler with a type that survives mypy: inner loops over pixels are compiled, everything else is numpy."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function to machine code on first use and keep the result on disk.

    It becomes part of whatever compiled function calls it. The loops over rays call dozens of small ones with many
    arguments: calls and counted references to arrays took more than half of their time.
    """
    machine_code: Callable[P, R] = numba.njit(cache=True, error_model="numpy", nogil=True, forceinline=True)(function)
    return machine_code

"""Numba's compiler: inner loops over pixels, rays and balls are compiled, everything else is numpy."""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, ParamSpec, Protocol, TypeVar

import numba
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)
from numba.core.runtime.nrt import rtsys

P = ParamSpec("P")
R = TypeVar("R")


class _BesideTheSource(InTreeCacheLocator):
    """Where machine code lies that can be read, although nothing can be written there: in the image of a container."""

    @classmethod
    def from_function(cls, function: Callable[..., object], file: str) -> "_BesideTheSource | None":
        """Where a function's machine code lies; None where there is none."""
        place = cls(function, file)
        folder = Path(file).parent / "__pycache__"
        found = any(folder.glob(f"*.{function.__qualname__}-*.nbi"))
        return place if found else None


class _Nowhere(InTreeCacheLocator):
    """A place that is not there: the function is compiled by every process anew."""

    @classmethod
    def from_function(cls, function: Callable[..., object], file: str) -> "_Nowhere":
        """Take any function."""
        return cls(function, file)


class _Places(CompileResultCacheImpl):
    """Where machine code may lie, the best place first."""

    _locator_classes = [  # noqa: RUF012 - as numba declares it
        UserProvidedCacheLocator,
        InTreeCacheLocator,
        _BesideTheSource,
        UserWideCacheLocator,
        _Nowhere,
    ]


class _MachineCodeOnDisk(FunctionCache):
    """Numba's cache of machine code, read without preparing the compiler, also where nothing can be written.

    Before it reads a file, numba's own cache loads the rules for lowering everything that it can compile. That takes
    a quarter of a second in each process, and machine code on disk does not need it. Without a file the compiler
    loads them itself.
    """

    _impl_class = _Places

    def load_overload(self, sig: object, target_context: object) -> object:
        """Machine code for arguments of these types, or None."""
        rtsys.initialize(target_context)  # machine code counts its references to arrays with it
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]  # of numba

    def save_overload(self, sig: object, data: object) -> None:
        """Keep machine code for the next process, where the place for it takes anything."""
        with suppress(OSError):
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]  # of numba

    def argument_types(self) -> Iterator[object]:
        """Types of arguments for which there is machine code, for whatever processor."""
        with suppress(OSError):
            yield from dict.fromkeys(key[0] for key in self._cache_file._load_index())  # type: ignore[no-untyped-call]


@dataclass(frozen=True, slots=True)
class Kernels:
    """What `load_kernels` has done.

    Attributes
    ----------
    loaded, compiled
        Number of pieces of machine code that were read, and that had to be made.
    """

    loaded: int
    compiled: int
    took_s: float

    @property
    def sentence(self) -> str:
        """For a log."""
        made = f", {self.compiled} compiled for this processor" if self.compiled else ""
        return f"{self.loaded} kernels read{made}, {self.took_s:.1f} s"


class _Statistics(Protocol):
    cache_hits: Counter[object]
    cache_misses: Counter[object]


class _Kernel(Protocol):
    """What is used of numba's dispatchers."""

    @property
    def stats(self) -> _Statistics:
        """How often machine code was found on disk, and how often not."""
        ...

    def compile(self, types: object) -> object:
        """Have machine code for arguments of these types."""
        ...


_kernels: Final[list[tuple[_Kernel, _MachineCodeOnDisk]]] = []


def load_kernels() -> Kernels:
    """Read the machine code of every kernel that this process has imported, so that no first image waits for it.

    What was compiled for another processor is compiled for this one. A kernel that was never called is left to its
    first call: `python -m distalock.prepare` calls all of them.
    """
    began_s = time.monotonic()
    for kernel, on_disk in _kernels:
        for types in on_disk.argument_types():
            kernel.compile(types)
    hits = sum(kernel.stats.cache_hits.total() for kernel, _ in _kernels)
    misses = sum(kernel.stats.cache_misses.total() for kernel, _ in _kernels)
    return Kernels(hits, misses, time.monotonic() - began_s)


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
    on_disk = _MachineCodeOnDisk(function)  # type: ignore[no-untyped-call]  # of numba
    dispatcher._cache = on_disk  # type: ignore[attr-defined]  # as `cache=True` does with numba's own cache
    if not forceinline:  # part of its callers' machine code
        _kernels.append((dispatcher, on_disk))  # type: ignore[arg-type]  # numba's stubs leave some out
    machine_code: Callable[P, R] = dispatcher
    return machine_code

"""Kernels that numba compiles for the processor it runs on, kept on disk: everywhere but in the images of services."""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Protocol

import numba
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)
from numba.core.runtime.nrt import rtsys

from shared.kernel_library import Kernels


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


class _Statistics(Protocol):
    cache_hits: Counter[object]
    cache_misses: Counter[object]


class Dispatcher(Protocol):
    """What is used of numba's dispatchers.

    Attributes
    ----------
    overloads
        What was compiled, by the types of the arguments.
    targetoptions
        How it is compiled.
    stats
        How often machine code was found on disk, and how often not, by the types of the arguments of the calls.
    """

    py_func: Callable[..., object]
    overloads: dict[Any, Any]
    targetoptions: dict[str, object]
    stats: _Statistics

    def compile(self, types: object) -> object:
        """Have machine code for arguments of these types."""
        ...


KERNELS: Final[list[Dispatcher]] = []
# Modules with anything that is compiled, also as a part of other kernels alone.
SOURCES: Final[set[str]] = set()
_on_disk: Final[list[_MachineCodeOnDisk]] = []


def compiled_by_numba(function: Callable[..., object], *, fastmath: bool, forceinline: bool) -> Callable[..., object]:
    """Have a function compiled on first use, and its machine code kept beside the source."""
    decorated = numba.njit(error_model="numpy", nogil=True, fastmath=fastmath, forceinline=forceinline)
    dispatcher = decorated(function)
    on_disk = _MachineCodeOnDisk(function)  # type: ignore[no-untyped-call]  # of numba
    dispatcher._cache = on_disk  # type: ignore[attr-defined]  # as `cache=True` does with numba's own cache
    SOURCES.add(function.__module__)
    if not forceinline:  # part of its callers' machine code
        KERNELS.append(dispatcher)  # type: ignore[arg-type]  # numba's stubs leave some out
        _on_disk.append(on_disk)
    machine_code: Callable[..., object] = dispatcher
    return machine_code


def load_from_disk() -> Kernels:
    """Read the machine code of every kernel that this process has imported."""
    began_s = time.monotonic()
    for kernel, on_disk in zip(KERNELS, _on_disk, strict=True):
        for types in on_disk.argument_types():
            kernel.compile(types)
    hits = sum(kernel.stats.cache_hits.total() for kernel in KERNELS)
    misses = sum(kernel.stats.cache_misses.total() for kernel in KERNELS)
    return Kernels(hits, misses, time.monotonic() - began_s)

"""Kernels in a library that was made beforehand: in the images of services, where there is no compiler.

The library is an extension module, made by `deploy/kernel_library.py`; a file beside it says which function it has for
which types of arguments, from which sources, and for which processors. Its functions take whatever they are given for
what they expect. So the types are compared before each call, the sources when it is opened, and the processor before
the first call.
"""

import hashlib
import importlib.util
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

import numpy as np

from shared.errors import ConfigurationError

MODULE: Final = "distalock_kernels"
CONTENTS: Final = f"{MODULE}.json"
# What machine code for such processors uses, by the names in /proc/cpuinfo.
CPU_FLAGS: Final[Mapping[str, frozenset[str]]] = {
    "x86-64-v3": frozenset({"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"}),
}
_CPU_INFO: Final = Path("/proc/cpuinfo")
# Types of an argument, as far as machine code depends on them: of an array its dtype, dimensions, layout, and whether
# it may be written and is aligned; of a tuple its name and those of what it holds; of a number its dtype.
Key = str | tuple[object, ...]
_WRITEABLE: Final = 3
_OF_ARRAY: Final = 5
_NUMBERS: Final[Mapping[type, Key]] = {
    float: "<f8",
    np.float64: "<f8",
    np.float32: "<f4",
    int: "<i8",
    np.int64: "<i8",
    bool: "|b1",
    np.bool_: "|b1",
}


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


def key_of(value: object) -> Key:
    """The types of an argument."""
    kind = type(value)
    if isinstance(value, np.ndarray):
        flags = value.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return value.dtype.str, value.ndim, layout, flags.writeable, flags.aligned
    if isinstance(value, tuple):
        return kind.__name__, *map(key_of, value)
    return _NUMBERS.get(kind, kind.__name__)


def name_of(function: Callable[..., object]) -> str:
    """A kernel's name in the library."""
    return f"{function.__module__}.{function.__qualname__}"


class LibraryKernel:
    """A kernel of the library: machine code for each of the types of arguments that are known."""

    def __init__(self, name: str, by_types: Mapping[tuple[Key, ...], Callable[..., object]]) -> None:
        self._name, self._by_types = name, by_types
        self._nearest: dict[tuple[Key, ...], Callable[..., object]] = {}

    def __call__(self, *arguments: object) -> object:
        """Call it; `TypeError` without machine code for these arguments."""
        types = tuple(map(key_of, arguments))
        machine_code = self._by_types.get(types)
        if machine_code is not None:
            return machine_code(*arguments)
        # Numba has refused, wherever the kernel was tried, to write to what is read-only: a copy loses nothing.
        return self._nearest_to(types)(*map(writeable, arguments))

    def _nearest_to(self, types: tuple[Key, ...]) -> Callable[..., object]:
        if types not in self._nearest:
            self._nearest[types] = self._found(types)
        return self._nearest[types]

    def _found(self, types: tuple[Key, ...]) -> Callable[..., object]:
        for known, machine_code in self._by_types.items():
            if are_alike(types, known):
                return machine_code
        raise TypeError(
            f"kernel {self._name} has no machine code for {types}, only for {', '.join(map(str, self._by_types))}; "
            "let distalock.prepare call it so, and build the image anew"
        )


def are_alike(given: Key, known: Key) -> bool:
    """Whether types are the same but for what of arrays may be written."""
    if given == known:
        return True
    if not isinstance(given, tuple) or not isinstance(known, tuple) or len(given) != len(known):
        return False
    if _is_array(given) and _is_array(known):
        return _apart_from_writing(given) == _apart_from_writing(known)
    return all(are_alike(cast("Key", one), cast("Key", other)) for one, other in zip(given, known, strict=True))


def _is_array(key: tuple[object, ...]) -> bool:
    return len(key) == _OF_ARRAY and isinstance(key[_WRITEABLE], bool)


def _apart_from_writing(key: tuple[object, ...]) -> tuple[object, ...]:
    return key[:_WRITEABLE] + key[_WRITEABLE + 1 :]


def writeable(value: object) -> object:
    """An argument with copies in place of arrays that may only be read."""
    if isinstance(value, np.ndarray):
        return value if value.flags.writeable else value.copy()
    if isinstance(value, tuple):
        held = map(writeable, value)
        return type(value)._make(held) if hasattr(value, "_make") else tuple(held)
    return value


class KernelLibrary:
    """The library of an installation.

    Parameters
    ----------
    kernels
        Machine code by the kernels' names and the types of their arguments.
    cpu
        The oldest processor that it is made for.
    """

    def __init__(self, kernels: Mapping[str, Mapping[tuple[Key, ...], Callable[..., object]]], cpu: str) -> None:
        self._kernels, self._cpu = kernels, cpu

    def kernel(self, function: Callable[..., object]) -> Callable[..., object]:
        """The machine code of a function; one that cannot be called where it is a part of other kernels alone."""
        name = name_of(function)
        by_types = self._kernels.get(name)
        return missing(name, "it is a part of others alone") if by_types is None else LibraryKernel(name, by_types)

    def checked(self) -> Kernels:
        """Refuse a processor on which the machine code does not run; raises `ConfigurationError`."""
        began_s = time.monotonic()
        lacking = CPU_FLAGS.get(self._cpu, frozenset()) - cpu_flags(_CPU_INFO)
        if lacking:
            raise ConfigurationError(
                f"the kernels of this image run on processors from {self._cpu} on, and this one lacks "
                f"{', '.join(sorted(lacking))}; build the images with --build-arg KERNEL_CPU=generic"
            )
        return Kernels(sum(map(len, self._kernels.values())), 0, time.monotonic() - began_s)


def cpu_flags(file: Path) -> frozenset[str]:
    """What the processor can do, as Linux says."""
    lines = file.read_text(encoding="ascii", errors="replace").splitlines() if file.exists() else []
    return frozenset(next((line.partition(":")[2].split() for line in lines if line.startswith("flags")), ()))


def missing(name: str, why: str) -> Callable[..., object]:
    """What stands for a kernel without machine code."""

    def kernel(*_: object) -> object:
        raise RuntimeError(f"kernel {name} has no machine code of its own: {why}")

    return kernel


def installed_library() -> KernelLibrary | None:
    """The library that is installed; None where numba compiles. Raises `ConfigurationError` when it is of others."""
    found = importlib.util.find_spec(MODULE)
    if found is None or found.origin is None:
        return None
    contents = json.loads(Path(found.origin).with_name(CONTENTS).read_text(encoding="utf-8"))
    for name, sha256 in contents["sources"].items():
        if source_sha256(name) not in (None, sha256):
            raise ConfigurationError(f"the kernels of this image are not made of its {name}; build the image anew")
    module = importlib.import_module(MODULE)
    kernels: dict[str, dict[tuple[Key, ...], Callable[..., object]]] = {}
    for entry in contents["kernels"]:
        types = tuple(_as_key(one) for one in entry["types"])
        kernels.setdefault(entry["name"], {})[types] = getattr(module, entry["symbol"])
    return KernelLibrary(kernels, contents["cpu"])


def source_sha256(module: str) -> str | None:
    """Hash of a module's source, as hexadecimal digits; None where it is not installed: another service's."""
    file = Path(__file__).parent.parent.joinpath(*module.split(".")).with_suffix(".py")
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None


def _as_key(stored: object) -> Key:
    if not isinstance(stored, list):
        return str(stored)
    return tuple(one if isinstance(one, bool | int) else _as_key(one) for one in stored)

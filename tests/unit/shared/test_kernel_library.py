"""The library of kernels: whatever it is given, machine code is only called with the types that it was made for."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from shared import kernel_library
from shared.errors import ConfigurationError
from shared.kernel_library import CONTENTS, KernelLibrary, LibraryKernel, are_alike, cpu_flags, key_of, source_sha256

FLOATS = ("<f8", 2, "C", True, True)
READ_ONLY = ("<f8", 2, "C", False, True)


class Pair(NamedTuple):
    """As kernels are given."""

    matrix: np.ndarray
    share: float


def kernel_of(*types: object) -> LibraryKernel:
    return LibraryKernel("some.kernel", {types: lambda *given: ("called with", *given)})  # type: ignore[dict-item]


@pytest.mark.parametrize(
    ("value", "key"),
    [
        (np.zeros((2, 3)), FLOATS),
        (np.zeros((3, 2)).T, ("<f8", 2, "F", True, True)),
        (np.zeros((4, 4))[::2, ::2], ("<f8", 2, "A", True, True)),
        (np.zeros(3, dtype=np.float32), ("<f4", 1, "C", True, True)),
        (np.zeros(3, dtype=">f8"), (">f8", 1, "C", True, True)),
        (1.0, "<f8"),
        (np.float64(1.0), "<f8"),
        (np.float32(1.0), "<f4"),
        (3, "<i8"),
        (True, "|b1"),
        ((1.0, 2), ("tuple", "<f8", "<i8")),
        (Pair(np.zeros((2, 2)), 0.5), ("Pair", FLOATS, "<f8")),
        (None, "NoneType"),
    ],
)
def test_types_are_what_machine_code_depends_on(value: object, key: object) -> None:
    assert key_of(value) == key


def test_machine_code_is_called_with_its_types_alone() -> None:
    kernel = kernel_of(FLOATS, "<f8")
    matrix = np.zeros((2, 2))
    assert kernel(matrix, 1.0) == ("called with", matrix, 1.0)
    for wrong in (matrix.astype(np.float32), matrix[:, :1], matrix.T[1:], np.zeros(2), [[0.0]]):
        with pytest.raises(TypeError, match=r"some\.kernel has no machine code for"):
            kernel(wrong, 1.0)
    with pytest.raises(TypeError, match=r"let distalock\.prepare call it so"):
        kernel(matrix, 1)


def test_an_array_that_may_only_be_read_is_copied_for_machine_code_that_might_write() -> None:
    frozen = np.arange(4.0).reshape(2, 2)
    frozen.flags.writeable = False
    called, given = kernel_of(("Pair", FLOATS, "<f8"), READ_ONLY)(Pair(frozen, 0.5), np.zeros((2, 2)))[1:]  # type: ignore[index]
    assert isinstance(called, Pair)
    assert np.array_equal(called.matrix, frozen)
    assert called.matrix.flags.writeable
    assert not np.shares_memory(called.matrix, frozen)
    assert given.flags.writeable
    kernel = kernel_of(READ_ONLY)
    assert kernel(frozen)[1] is frozen  # type: ignore[index]


def test_alike_is_what_differs_in_nothing_but_writing() -> None:
    assert are_alike(("Pair", FLOATS, "<f8"), ("Pair", READ_ONLY, "<f8"))
    for other in (("Other", FLOATS, "<f8"), ("Pair", FLOATS, "<i8"), ("Pair", FLOATS), "<f8"):
        assert not are_alike(("Pair", FLOATS, "<f8"), other)
    assert not are_alike(FLOATS, ("<f8", 2, "F", False, True))


def test_a_kernel_that_is_only_a_part_of_others_is_not_called() -> None:
    library = KernelLibrary({}, "generic")
    with pytest.raises(RuntimeError, match="kernel_of has no machine code of its own: it is a part of others alone"):
        library.kernel(kernel_of)()


def test_a_processor_that_lacks_something_is_refused_before_the_first_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "cpuinfo"
    info.write_text("processor\t: 0\nflags\t\t: fpu avx avx2 bmi1 bmi2 f16c abm movbe\n")
    monkeypatch.setattr(kernel_library, "_CPU_INFO", info)
    assert "avx2" in cpu_flags(info)
    with pytest.raises(ConfigurationError, match=r"from x86-64-v3 on, and this one lacks fma; build .*KERNEL_CPU="):
        KernelLibrary({}, "x86-64-v3").checked()
    assert KernelLibrary({"one": {(): lambda: None}}, "generic").checked().loaded == 1


def test_a_library_is_opened_when_it_is_of_these_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = "distalock_test_kernels"
    (tmp_path / f"{name}.py").write_text("def kernel_0(values):\n    return values.sum()\n")
    stored: dict[str, object] = {
        "cpu": "generic",
        "sources": {"shared.equipment": source_sha256("shared.equipment"), "services.of_another.image": "abc"},
        "kernels": [{"name": "some.kernel", "symbol": "kernel_0", "types": [["<f8", 2, "C", True, True]]}],
    }
    contents = tmp_path / CONTENTS
    contents.write_text(json.dumps(stored))
    monkeypatch.setattr(kernel_library, "MODULE", name)
    monkeypatch.syspath_prepend(str(tmp_path))
    library = kernel_library.installed_library()
    assert library is not None
    monkeypatch.setattr(kernel_of, "__module__", "some")
    monkeypatch.setattr(kernel_of, "__qualname__", "kernel")
    assert library.kernel(kernel_of)(np.ones((2, 2))) == 4.0
    contents.write_text(json.dumps(stored | {"sources": {"shared.equipment": "abc"}}))
    with pytest.raises(ConfigurationError, match=r"are not made of its shared\.equipment; build the image anew"):
        kernel_library.installed_library()


def test_where_there_is_no_library_numba_compiles() -> None:
    assert kernel_library.installed_library() is None

"""The library of kernels that images hold: the same numbers as numba's, for the types that it was made for."""

import runpy
import shutil
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from shared.kernel_library import MODULE, installed_library, key_of

ROOT = Path(__file__).resolve().parents[3]


class Line(NamedTuple):
    """As kernels are given."""

    offsets: NDArray[np.float64]
    slope: float


def _filled(line: Line, out: NDArray[np.float64]) -> float:
    for k in range(out.size):
        out[k] = line.offsets[k] + line.slope * k
    return float(np.exp(out.sum()))


VALUES = Line(np.array([0.1, -0.2, 0.05]), 0.01), np.zeros(3)


@pytest.fixture(scope="module")
def builder() -> dict[str, Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numba says that its ahead-of-time compiler will be replaced
        return runpy.run_path(str(ROOT / "deploy" / "kernel_library.py"))


@pytest.mark.parametrize(
    "value",
    [
        np.zeros((2, 2), dtype=np.float32),
        np.zeros((3, 2)).T,
        np.zeros((4, 4))[::2, ::2],
        np.zeros(2, dtype=bool),
        np.zeros(2, dtype=complex),
        1.5,
        3,
        True,
        (1.0, 2.0),
        (1, 2.0),
        VALUES[0],
    ],
)
def test_types_of_a_call_are_those_of_numba(builder: dict[str, Any], value: object) -> None:
    typeof: Callable[[object], object] = numba.typeof
    assert builder["key_of_type"](typeof(value)) == key_of(value)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler (apt-get install g++)")
def test_a_kernel_of_the_library_gives_the_same_numbers(
    builder: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dispatcher = numba.njit(error_model="numpy", nogil=True)(_filled)
    expected, written = dispatcher(*VALUES), VALUES[1].copy()
    overload: Any = dispatcher.overloads[dispatcher.signatures[0]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        builder["compile_library"]([builder["KernelEntry"](0, dispatcher, overload.signature)], tmp_path, "host")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(sys.modules, MODULE, None)  # gone afterwards, as it was before
    del sys.modules[MODULE]
    library = installed_library()
    assert library is not None
    out = np.zeros(3)
    assert library.kernel(_filled)(VALUES[0], out) == expected
    assert np.array_equal(out, written)
    with pytest.raises(TypeError, match="no machine code"):
        library.kernel(_filled)(VALUES[0], np.zeros(3, dtype=np.float32))

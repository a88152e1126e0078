"""Small libraries in the place of large ones that OpenCV's wheel brings: `python deploy/stand_ins.py PACKAGES CODE`.

The wheel holds an OpenBLAS of its own beside SciPy's, and codecs. The loader asks for both at every start, whoever
needs them. In the place of OpenBLAS stands a library that hands each function on to SciPy's, which has the same ones
under other names; where the code reads no video, in the place of the codecs stand libraries whose functions do nothing
and return 0. Symbols and versions are read from OpenCV itself, so that a function that is missing ends the build.
"""

import platform
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

_MODULE: Final = "cv2/cv2.abi3.so"
_FOLDER: Final = "opencv_python_headless.libs"
_BLAS: Final = "libopenblas"
# What only video needs; images are read by what stays.
_CODECS: Final = ("libavcodec", "libavformat", "libavutil", "libswscale")
_USES_VIDEO: Final = "VideoCapture"
_MACHINE: Final = "x86_64"
_HANDED_ON: Final = ".globl {name}\n.type {name}, @function\n{name}:\n    jmp scipy_{name}@PLT\n"
_NOTHING: Final = ".globl {name}\n.type {name}, @function\n{name}:\n    xorl %eax, %eax\n    ret\n"
_NO_STACK: Final = '.section .note.GNU-stack,"",@progbits\n'


def symbols_of(library: Path, kind: str) -> set[str]:
    """Names with versions, as `open@LIB_1`, that a library defines or asks for."""
    said = subprocess.run(["nm", "--dynamic", f"--{kind}", str(library)], check=True, capture_output=True, text=True)  # noqa: S603, S607 - in builds
    return {line.split()[-1].replace("@@", "@") for line in said.stdout.splitlines() if line.strip()}


def assembly(names: Sequence[str], of_each: str) -> str:
    """Source of a library with these functions."""
    return ".text\n" + "".join(of_each.format(name=name) for name in names) + _NO_STACK


def versions(symbols: Sequence[str]) -> str:
    """Script for the linker that gives symbols their versions."""
    by_version: Mapping[str, list[str]] = defaultdict(list)
    for name, _, version in (symbol.partition("@") for symbol in symbols):
        by_version[version].append(name)
    return "".join(
        f"{version} {{ global: {'; '.join(names)}; }};\n" for version, names in by_version.items() if version
    )


def replace(library: Path, symbols: Sequence[str], of_each: str, words: Sequence[str]) -> None:
    """Assemble and link a stand-in for a library, under its name."""
    with tempfile.TemporaryDirectory() as folder:
        source, built, script = (Path(folder) / name for name in ("stand_in.s", "stand_in.o", "versions"))
        source.write_text(assembly([symbol.partition("@")[0] for symbol in symbols], of_each), encoding="ascii")
        subprocess.run(["as", "-o", str(built), str(source)], check=True)  # noqa: S603, S607
        if text := versions(symbols):
            script.write_text(text, encoding="ascii")
            words = [*words, f"--version-script={script}"]
        linked = ["ld", "-shared", "-soname", library.name, "-z", "now", "-o", str(library), str(built), *words]
        library.unlink()
        subprocess.run(linked, check=True)  # noqa: S603


def main(packages: Path, code: Path) -> None:
    """Put the stand-ins in place, where OpenCV is."""
    module, folder = packages / _MODULE, packages / _FOLDER
    if not module.exists() or platform.machine() != _MACHINE:
        return
    asked = symbols_of(module, "undefined-only")
    (blas,) = folder.glob(f"{_BLAS}*")
    (other,) = (packages / "scipy.libs").glob("libscipy_openblas-*")
    of_blas = sorted(asked & symbols_of(blas, "defined-only"))
    replace(blas, of_blas, _HANDED_ON, [str(other), "-rpath", "$ORIGIN/../scipy.libs", "--no-undefined"])
    if any(_USES_VIDEO in file.read_text(encoding="utf-8") for file in code.rglob("*.py")):
        return
    for name in _CODECS:
        for library in folder.glob(f"{name}*"):
            replace(library, sorted(asked & symbols_of(library, "defined-only")), _NOTHING, [])


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

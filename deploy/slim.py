"""Leave in an image what its programs can reach: `python deploy/slim.py PACKAGES CODE`; for builds of images only.

Imports every module of the code, which also writes its byte code for a quick start. Then removes from the packages
their tests, headers and type stubs, and those parts of SciPy that neither were imported nor are named anywhere in the
code; strips symbols of shared libraries; keeps files that are there several times once; and leaves of the packages'
sources the byte code alone, without docstrings: a tracer's lines still have their numbers, and our own code its text.
"""

import ast
import hashlib
import importlib
import os
import py_compile
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

# Packages of many parts that hardly depend on each other, of which a service uses some.
DIVISIBLE: Final = ("scipy",)
_FOLDERS: Final = frozenset({"tests", "include"})
_ENDINGS: Final = frozenset({".pyi", ".h", ".hpp", ".pxd", ".a", ".c", ".cpp"})
# Whose libraries hold symbols for debuggers. Libraries that a wheel's tools have patched do not load without theirs.
STRIPPED: Final = ("zenoh", "llvmlite")
_ELF: Final = b"\x7fELF"
# Reads files of its own sources as configuration.
KEPT_AS_SOURCES: Final = ("cv2",)
_WITHOUT_DOCSTRINGS: Final = 2
# Worth a link; below it one costs as much.
_LEAST_SHARED_BYTES: Final = 4096


def modules_of(code: Path) -> Iterator[str]:
    """Names of all modules below a folder."""
    for file in sorted(code.rglob("*.py")):
        parts = file.relative_to(code).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def import_all(code: Path) -> list[str]:
    """Import every module whose packages are there; the names of those that cannot be imported."""
    left_out = []
    for name in modules_of(code):
        try:
            importlib.import_module(name)
        except Exception as error:  # noqa: BLE001 - a migration, too, which only its own program may import
            left_out.append(f"{name} ({error})")
    return left_out


def parts_named(code: Path, package: str) -> set[str]:
    """Parts of a package that any import of the code names, also one inside a function."""
    named = set()
    for file in code.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            named |= {name.split(".")[1] for name in names if name.startswith(f"{package}.")}
    return named


def remove_unused_parts(packages: Path, code: Path, package: str) -> None:
    """Remove the parts of a package that nothing has imported and nothing names."""
    imported = {name.split(".")[1] for name in sys.modules if name.startswith(f"{package}.")}
    kept = imported | parts_named(code, package)
    for part in (packages / package).iterdir() if imported else ():
        if part.is_dir() and (part / "__init__.py").exists() and part.name not in kept:
            shutil.rmtree(part)


def remove_what_no_program_reads(packages: Path) -> None:
    """Tests, headers and type stubs."""
    for folder in sorted(packages.rglob("*"), reverse=True):
        if folder.is_dir() and not folder.is_symlink() and folder.name in _FOLDERS:
            shutil.rmtree(folder)
    for file in packages.rglob("*"):
        if file.is_file() and file.suffix in _ENDINGS:
            file.unlink()


def strip_libraries(packages: Path) -> None:
    """Remove symbols that are for debuggers, where there is a tool for that."""
    if (strip := shutil.which("strip")) is None:
        return
    for file in (file for name in STRIPPED for file in (packages / name).rglob("*.so*")):
        if file.is_file() and not file.is_symlink() and file.read_bytes()[:4] == _ELF:
            subprocess.run([strip, "--strip-unneeded", str(file)], check=True)  # noqa: S603 - files of the image


def keep_once(packages: Path) -> None:
    """Replace what lies in one folder several times, as wheels hold symbolic links, by links to the first."""
    seen: dict[tuple[Path, str], Path] = {}
    for file in sorted(packages.rglob("*.so*")):
        if file.is_file() and not file.is_symlink() and file.stat().st_size >= _LEAST_SHARED_BYTES:
            key = file.parent, hashlib.sha256(file.read_bytes()).hexdigest()
            first = seen.setdefault(key, file)
            if first is not file:
                file.unlink()
                file.symlink_to(os.path.relpath(first, file.parent))


def keep_byte_code_alone(packages: Path) -> None:
    """Replace sources by byte code in their place, which Python imports as it would the sources."""
    for file in sorted(packages.rglob("*.py")):
        if file.relative_to(packages).parts[0] in KEPT_AS_SOURCES:
            continue
        with suppress(py_compile.PyCompileError):  # a template of another language, or of another Python
            py_compile.compile(str(file), f"{file}c", doraise=True, optimize=_WITHOUT_DOCSTRINGS)
            file.unlink()
    for folder in sorted(packages.rglob("__pycache__")):
        if folder.relative_to(packages).parts[0] not in KEPT_AS_SOURCES:
            shutil.rmtree(folder)


def main(packages: Path, code: Path) -> None:
    """Slim both; modules that cannot be imported are printed, for they are of no use in this image."""
    sys.path[:0] = [str(packages), str(code)]
    for name in import_all(code):
        print(f"not in this image: {name}")  # noqa: T201 - the log of the build
    for package in DIVISIBLE:
        remove_unused_parts(packages, code, package)
    remove_what_no_program_reads(packages)
    strip_libraries(packages)
    keep_once(packages)
    keep_byte_code_alone(packages)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

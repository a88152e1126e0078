"""Leave in an image what its programs can reach: `python deploy/slim.py PACKAGES CODE FOLDER...`; for builds only.

Removes modules of `shared` that nothing in the service's own folders imports, directly or not. Imports every module of
what is left, which also writes its byte code for a quick start. Then removes from the packages their tests, headers,
type stubs and data for examples, those parts and extension modules of the large ones that neither were imported nor are
named anywhere in the code, and libraries that nothing asks for; strips symbols of shared libraries; keeps files that
are there several times once; and leaves of the packages' sources the byte code alone, without docstrings: a tracer's
lines still have their numbers, and our own code its text.
"""

import ast
import hashlib
import importlib
import os
import py_compile
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

# Packages of many parts that hardly depend on each other, of which a service uses some.
DIVISIBLE: Final = ("scipy", "pydantic")
# Of which a part imports all others, although each can do without them; where code names that part alone, it is alone.
NARROWED: Final = {"scipy.spatial": "scipy.spatial.transform"}
# Started by the compose file, and imported by nothing.
_STARTED: Final = ("shared/runtime/health.py", "shared/runtime/ready_check.py")
_COMMON: Final = "shared"
# Beside tests and headers: OpenCV's trained faces, and lists of what went into a wheel.
_FOLDERS: Final = frozenset({"tests", "include", "sboms"})
_LEFT_OUT: Final = (
    "cv2/data/*.xml",
    "numpy/_core/_simd.*.so",
    "numpy/_core/*_tests.*.so",
    "pydicom/data/test_files/*",
    "pydantic/mypy.py",
    "pydantic/color.py",
    "annotated_types/test_cases.py",
    "structlog/twisted.py",
    "structlog/_greenlets.py",
    "*.dist-info/RECORD",
)
_ENDINGS: Final = frozenset({".pyi", ".pyx", ".h", ".hpp", ".pxd", ".a", ".c", ".cpp"})
# Whose libraries hold symbols for debuggers. Libraries that a wheel's tools have patched do not load without theirs.
STRIPPED: Final = ("zenoh", "llvmlite")
_ELF: Final = b"\x7fELF"
# Reads files of its own sources as configuration.
KEPT_AS_SOURCES: Final = ("cv2",)
_WITHOUT_DOCSTRINGS: Final = 2
# Of which byte code saves less than a tenth of a second at each start, and takes as much room as their sources.
_FEW_MODULES: Final = 50
# What reads it.
_CATALOGUE: Final = "shared/parts/catalogue", "shared/parts/catalogue.py"
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


def names_imported(file: Path) -> set[str]:
    """What a file imports, also inside a function: modules, and what it takes from them by name."""
    named: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = "" if node.module is None else f"{node.module}."
            named |= {start.rstrip("."), *(f"{start}{alias.name}" for alias in node.names)}
    return named


def parts_named(code: Path, package: str) -> set[str]:
    """Parts of a package that any import of the code names."""
    named = set().union(*(names_imported(file) for file in code.rglob("*.py")))
    return {name.split(".")[1] for name in named if name.startswith(f"{package}.")}


def reached(code: Path, roots: Iterable[Path]) -> set[Path]:
    """Files that some files import, directly or not, and those files themselves."""
    found: set[Path] = set()
    left = list(roots)
    while left:
        if (file := left.pop()) not in found:
            found.add(file)
            places = [code.joinpath(*name.split(".")) for name in names_imported(file)]
            files = [place.with_suffix(".py") for place in places] + [place / "__init__.py" for place in places]
            left += [imported for imported in files if imported.is_file()]
    return found


def remove_unreached(code: Path, own: Sequence[str]) -> None:
    """Remove modules of the common package that the service's own folders do not import."""
    places = [code / name for name in own]
    roots = {file for place in places for file in ([place] if place.is_file() else place.rglob("*.py"))}
    kept = reached(code, roots | {code / name for name in _STARTED})
    for file in (code / _COMMON).rglob("*.py"):
        if file not in kept and file.name != "__init__.py":  # a package may hold data
            file.unlink()
    catalogue, reader = (code / place for place in _CATALOGUE)
    if not reader.exists():
        shutil.rmtree(catalogue, ignore_errors=True)


def remove_byte_code_of_few(code: Path) -> None:
    """Remove the byte code of programs that start quickly without it."""
    if sum(1 for _ in modules_of(code)) <= _FEW_MODULES:
        for folder in list(code.rglob("__pycache__")):
            shutil.rmtree(folder)


def narrow(packages: Path, code: Path) -> None:
    """Empty the start of packages of which the code names one part alone."""
    named = set().union(*(names_imported(file) for file in code.rglob("*.py")))
    for package, part in NARROWED.items():
        start = packages.joinpath(*package.split("."), "__init__.py")
        of_package = {name for name in named if name.startswith(f"{package}.")}
        if start.exists() and of_package and all(name == part or name.startswith(f"{part}.") for name in of_package):
            start.write_text("", encoding="utf-8")


def remove_unused_parts(packages: Path, code: Path, package: str) -> None:
    """Remove the parts of a package that nothing has imported and nothing names."""
    imported = {name.split(".")[1] for name in sys.modules if name.startswith(f"{package}.")}
    kept = imported | parts_named(code, package)
    for part in (packages / package).iterdir() if imported else ():
        if part.is_dir() and (part / "__init__.py").exists() and part.name not in kept:
            shutil.rmtree(part)
    if imported:
        remove_unused_extensions(packages / package)


def remove_unused_extensions(package: Path) -> None:
    """Remove extension modules that nothing has imported and nothing in their package names, as at a later call."""
    imported = {getattr(module, "__file__", None) for module in sys.modules.values()}
    named = set().union(*(names_imported(file) for file in package.rglob("*.py")))
    last_words = {word for name in named for word in name.split(".")}
    for file in package.rglob("*.so"):
        if str(file) not in imported and file.name.split(".")[0] not in last_words:
            file.unlink()


def remove_unneeded_libraries(packages: Path) -> None:
    """Remove what a wheel brings in its folder `*.libs` and nothing of the wheel asks for by its name."""
    while True:
        held = [file for file in packages.rglob("*.so*") if file.is_file() and not file.is_symlink()]
        content = {file: file.read_bytes() for file in held}
        unneeded = [
            file
            for file in held
            if file.parent.name.endswith(".libs")
            and not any(file.name.encode() in content[other] for other in held if _of_one_wheel(file, other))
        ]
        if not unneeded:
            return
        for file in unneeded:
            file.unlink()


def _of_one_wheel(library: Path, other: Path) -> bool:
    return other != library and (other.parent == library.parent or not other.parent.name.endswith(".libs"))


def remove_what_no_program_reads(packages: Path) -> None:
    """Tests, headers, type stubs, and data for examples."""
    for folder in sorted(packages.rglob("*"), reverse=True):
        if folder.is_dir() and not folder.is_symlink() and folder.name in _FOLDERS:
            shutil.rmtree(folder)
    for file in packages.rglob("*"):
        if file.is_file() and file.suffix in _ENDINGS:
            file.unlink()
    for file in (file for pattern in _LEFT_OUT for file in packages.glob(pattern)):
        shutil.rmtree(file) if file.is_dir() else file.unlink()
    for file in packages.glob("*.dist-info/METADATA"):  # its head is read for the version; below is the package's page
        file.write_text(file.read_text(encoding="utf-8").partition("\n\n")[0] + "\n", encoding="utf-8")


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


def main(packages: Path, code: Path, own: Sequence[str]) -> None:
    """Slim both; modules that cannot be imported are printed, for they are of no use in this image."""
    sys.path[:0] = [str(packages), str(code)]
    remove_unreached(code, own)
    narrow(packages, code)
    for name in import_all(code):
        print(f"not in this image: {name}")  # noqa: T201 - the log of the build
    remove_what_no_program_reads(packages)
    for package in DIVISIBLE:
        remove_unused_parts(packages, code, package)
    remove_unneeded_libraries(packages)
    strip_libraries(packages)
    keep_once(packages)
    keep_byte_code_alone(packages)
    remove_byte_code_of_few(code)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])

"""What is left in an image: what the service's own files reach, and of packages what they use."""

import runpy
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
SLIM = runpy.run_path(str(ROOT / "deploy" / "slim.py"))
STARTS = "from ._kdtree import *\n"


def written(folder: Path, files: Mapping[str, str]) -> Path:
    """Files by their paths."""
    for name, text in files.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return folder


def test_modules_stay_that_the_service_reaches_also_from_within_a_function(tmp_path: Path) -> None:
    code = written(
        tmp_path,
        {
            "services/one/main.py": "from shared.a import x\n",
            "shared/__init__.py": "",
            "shared/a.py": "def late():\n    import shared.b\n",
            "shared/b.py": "from shared import c\n",
            "shared/c.py": "",
            "shared/d.py": "import shared.a\n",
            "shared/runtime/health.py": "import shared.e\n",
            "shared/runtime/ready_check.py": "",
            "shared/e.py": "",
        },
    )
    SLIM["remove_unreached"](code, ["services/one"])
    left = {str(file.relative_to(code / "shared")) for file in (code / "shared").rglob("*.py")}
    assert left == {"__init__.py", "a.py", "b.py", "c.py", "e.py", "runtime/health.py", "runtime/ready_check.py"}


@pytest.mark.parametrize(("reader", "left"), [("shared.parts.catalogue", True), ("shared.other", False)])
def test_parts_of_the_catalogue_stay_where_a_program_reads_them(tmp_path: Path, reader: str, *, left: bool) -> None:
    code = written(
        tmp_path,
        {
            "services/one/main.py": f"import {reader}\n",
            "shared/other.py": "",
            "shared/runtime/health.py": "",
            "shared/runtime/ready_check.py": "",
            "shared/parts/catalogue.py": "",
            "shared/parts/catalogue/nail.json": "{}",
        },
    )
    SLIM["remove_unreached"](code, ["services/one"])
    assert (code / "shared/parts/catalogue/nail.json").exists() is left


@pytest.mark.parametrize(("modules", "left"), [(49, False), (60, True)])
def test_byte_code_stays_where_there_is_much_to_compile(tmp_path: Path, modules: int, *, left: bool) -> None:
    code = written(tmp_path, {f"shared/m{number}.py": "" for number in range(modules)})
    written(code, {"shared/__pycache__/m0.cpython-311.pyc": ""})
    SLIM["remove_byte_code_of_few"](code)
    assert (code / "shared/__pycache__").exists() is left


@pytest.mark.parametrize(
    ("imports", "left"),
    [
        ("from scipy.spatial.transform import Rotation\n", ""),
        ("from scipy.spatial.transform import Rotation\nfrom scipy.spatial import cKDTree\n", STARTS),
        ("import numpy\n", STARTS),
    ],
)
def test_the_start_of_a_package_is_emptied_where_one_part_alone_is_used(
    tmp_path: Path, imports: str, left: str
) -> None:
    packages = written(tmp_path / "packages", {"scipy/spatial/__init__.py": STARTS})
    SLIM["narrow"](packages, written(tmp_path / "code", {"one.py": imports}))
    assert (packages / "scipy/spatial/__init__.py").read_text() == left


def test_an_extension_stays_that_was_imported_or_that_its_package_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = written(tmp_path / "one", {"late.py": "def call():\n    from . import _named\n"})
    for name in ("_imported", "_named", "_unused"):
        (package / f"{name}.cpython-311.so").touch()
    module = type(sys)("one._imported")
    module.__file__ = str(package / "_imported.cpython-311.so")
    monkeypatch.setitem(sys.modules, "one._imported", module)
    SLIM["remove_unused_extensions"](package)
    assert {file.name.split(".")[0] for file in package.glob("*.so")} == {"_imported", "_named"}


def test_libraries_stay_that_something_of_their_wheel_asks_for(tmp_path: Path) -> None:
    for folder, name, content in (
        ("one", "module.so", b"needs libfirst.so"),
        ("one.libs", "libfirst.so", b"needs libsecond.so"),
        ("one.libs", "libsecond.so", b""),
        ("one.libs", "libthird.so", b"libthird.so"),
        ("two.libs", "libfourth.so", b"needs libthird.so"),
    ):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / name).write_bytes(content)
    SLIM["remove_unneeded_libraries"](tmp_path)
    assert {file.name for file in tmp_path.rglob("*.so")} == {"module.so", "libfirst.so", "libsecond.so"}

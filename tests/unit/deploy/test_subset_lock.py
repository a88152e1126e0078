"""The lock's subset for a container: complete, and no more than that."""

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
TOOL = runpy.run_path(str(ROOT / "deploy" / "subset_lock.py"))

LOCK = """\
numpy==2.4.6 \\
    --hash=sha256:aa
    # via
    #   distalock (pyproject.toml)
    #   scipy
scipy==1.17.1 \\
    --hash=sha256:bb
    # via distalock (pyproject.toml)
starlette==1.10.0 \\
    --hash=sha256:cc
    # via fastapi
fastapi==0.165.0 \\
    --hash=sha256:dd
    # via distalock (pyproject.toml)
"""


def test_takes_what_the_roots_need_directly_and_indirectly() -> None:
    cut = TOOL["subset"](LOCK, {"fastapi"})
    assert "fastapi==0.165.0" in cut
    assert "starlette==1.10.0" in cut
    assert "--hash=sha256:cc" in cut
    assert "numpy" not in cut


def test_robot_container_needs_no_image_library() -> None:
    lock = (ROOT / "requirements.lock").read_text()
    roots = TOOL["wanted_roots"]((ROOT / "pyproject.toml").read_text(), "robot")
    cut = TOOL["subset"](lock, roots)
    assert "pyserial==" in cut
    assert "pydantic-core==" in cut
    assert "opencv-python-headless==" not in cut
    assert "fastapi==" not in cut


def test_lock_names_no_server_and_hashes_everything() -> None:
    lock = (ROOT / "requirements.lock").read_text()
    assert "://" not in lock
    for name, text, via in TOOL["lock_entries"](lock):
        assert "--hash=sha256:" in text, name
        assert via, f"{name} says not what asks for it"


def test_unknown_extra_is_refused() -> None:
    with pytest.raises(KeyError):
        TOOL["wanted_roots"]((ROOT / "pyproject.toml").read_text(), "kitchen")

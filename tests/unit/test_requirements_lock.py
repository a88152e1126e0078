"""The lock file and `pyproject.toml` agree: every requirement of every extra has a locked version that satisfies it."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# The Dask cluster's own packages are installed by whoever runs one.
NOT_LOCKED = {"bench"}


def locked_versions(text: str) -> dict[str, str]:
    """Version of each package in a requirements file."""
    found = re.findall(r"^([A-Za-z0-9._-]+)==([^\s;\\]+)", text, re.MULTILINE)
    return {canonicalize_name(name): version for name, version in found}


def unsatisfied(requirements: list[str], locked: dict[str, str]) -> list[str]:
    """What is not locked, or locked at another version."""
    wanted = [one for one in map(Requirement, requirements) if one.name != PROJECT["name"]]
    versions = [locked.get(canonicalize_name(one.name)) for one in wanted]
    satisfied = [v is not None and one.specifier.contains(v) for one, v in zip(wanted, versions, strict=True)]
    return [str(one) for one, good in zip(wanted, satisfied, strict=True) if not good]


def test_the_lock_satisfies_every_extra() -> None:
    locked = locked_versions((ROOT / "requirements.lock").read_text())
    extras = PROJECT["optional-dependencies"]
    everything = [*PROJECT["dependencies"], *(r for name in extras.keys() - NOT_LOCKED for r in extras[name])]
    assert unsatisfied(everything, locked) == [], "run `make lock` and commit requirements.lock"


@pytest.mark.parametrize("requirement", ["numpy>=3", "missing", "scipy<1"])
def test_what_the_lock_does_not_satisfy_is_named(requirement: str) -> None:
    assert unsatisfied([requirement], {"numpy": "2.1.0", "scipy": "1.16.0"}) == [requirement]


def test_every_extra_that_is_locked_belongs_to_the_development_environment() -> None:
    extras = PROJECT["optional-dependencies"]
    product, development = (
        set(re.findall(r"[a-z-]+", re.findall(r"\[(.*)\]", extras[name][0])[0])) for name in ("all", "dev")
    )
    shared = {"numerics"}  # what several of them name
    assert "all" in development
    assert product | development | shared | {"dev"} | NOT_LOCKED == set(extras)


@pytest.mark.parametrize(
    "lock", ["requirements.lock", "services/ui_api/console/package-lock.json", "services/ui_api/console/node.lock"]
)
def test_no_lock_names_a_server(lock: str) -> None:
    """Where packages come from is the affair of the machine; npm also writes whom to give money (`funding`)."""
    assert re.findall(r"\w+://[^\s\"]+", (ROOT / lock).read_text()) == [], "delete `resolved` and `funding`"

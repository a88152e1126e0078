"""Say in an image which version of which revision it is: `python deploy/dist_info.py PACKAGES REVISION`.

Images hold the sources of one service and no wheel of the project. Its metadata, which every program asks for its
version, is written here; the revision becomes the local part of the version (PEP 440), as in ``0.1.0+g6e6ceab``.
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def version_of(version: str, revision: str) -> str:
    """Version with a revision; without one as it is. A plus, which marks changes, becomes a word."""
    local = re.sub(r"[^A-Za-z0-9.]", "", revision.replace("+", ".changed"))
    return f"{version}+g{local}" if local else version


def main(packages: Path, revision: str) -> None:
    """Write the metadata."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    version = version_of(project["version"], revision)
    folder = packages / f"{project['name']}-{version}.dist-info"
    folder.mkdir(parents=True)
    lines = {
        "Metadata-Version": "2.1",
        "Name": project["name"],
        "Version": version,
        "Summary": project["description"],
        "License": project["license"],
    }
    (folder / "METADATA").write_text("".join(f"{name}: {value}\n" for name, value in lines.items()))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])

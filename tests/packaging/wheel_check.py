"""Builds the wheel, installs it with its `cli` extra into an empty environment, and runs the commands on an image.

``python -m tests.packaging.wheel_check`` (`make wheel-check`); takes minutes, because kernels are compiled anew.
"""

import json
import os
import subprocess
import sys
import tempfile
import venv
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import cv2

from simulation.render.image import render_scene
from simulation.scenario.sampling import scenario_of_seed
from simulation.world.poses import starting_state
from tools.wheel import built_wheel

SEED: Final = 2


def main() -> int:
    """Build, install and run; the exit code is 0 when every command does what it should."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        command = installed(built_wheel(folder, datetime.now(UTC)), folder / "environment")
        wrong = [sentence for sentence in checks(command, folder) if sentence]
    for sentence in wrong:
        print(f"wheel: {sentence}", file=sys.stderr)
    print("wheel: all commands work" if not wrong else f"wheel: {len(wrong)} commands do not work")
    return int(bool(wrong))


def installed(wheel: Path, environment: Path) -> Path:
    """The command of an environment that has nothing but the wheel and what its `cli` extra asks for."""
    venv.create(environment, with_pip=True)
    words = ["install", "--quiet", "--disable-pip-version-check", f"{wheel}[cli]"]
    subprocess.run([str(environment / "bin" / "python"), "-m", "pip", *words], check=True)
    return environment / "bin" / "distalock"


def checks(command: Path, folder: Path) -> list[str]:
    """Run every command in an empty folder; one sentence for each that does not work, empty for the others."""
    images = folder / "images"
    images.mkdir()
    scenario = scenario_of_seed(SEED)
    image = images / "image.png"
    cv2.imwrite(str(image), render_scene(scenario, starting_state(scenario)).pixels)
    sources = scenario.sources
    parts = ["--ring", sources.ring.name, "--guide", sources.guide.name, "--nail", sources.nail.name]
    run = Runner(command, folder)
    return [
        run.printed_json(["locate", str(image), *parts], "localisation", {0}),
        run.printed_json(["locate", "--each", str(images), *parts], "localisation", {0}),
        run.printed_json(["verify", str(image), *parts], "verification", {3}),  # there are no wires
        run.printed_json(["align", str(image), *parts], "guidance", {0}),
        run.ended(
            ["qa", str(images), "--ring", sources.ring.name, "--out", str(folder / "qa")], {0, 3}, "1 of 1 images"
        ),
        run.imported("distalock.client"),
        run.ended(["--version"], {0}, "distalock "),
        run.ended(["bench"], {2}, "benchmarks need a checkout"),
    ]


class Runner:
    """Runs the installed command, where nothing of the checkout can be imported."""

    def __init__(self, command: Path, folder: Path) -> None:
        self._command, self._folder = command, folder / "empty"
        self._folder.mkdir()
        self._environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}

    def imported(self, name: str) -> str:
        """A sentence unless a module can be imported."""
        words = [str(self._command.with_name("python")), "-c", f"import {name}"]
        done = subprocess.run(
            words, cwd=self._folder, env=self._environment, capture_output=True, text=True, check=False
        )
        return f"{name} cannot be imported: {done.stderr}" if done.returncode else ""

    def ended(self, words: list[str], codes: set[int], text: str) -> str:
        """A sentence unless the command ends with one of the exit codes and prints the text."""
        words = [str(self._command), *words]
        done = subprocess.run(
            words, cwd=self._folder, env=self._environment, capture_output=True, text=True, check=False
        )
        print(
            f"wheel: {words[1]} ended with {done.returncode}: {(done.stdout or done.stderr)[:100].strip()}", flush=True
        )
        if done.returncode in codes and text in done.stdout + done.stderr:
            return ""
        return f"{' '.join(words[1:3])} ended with {done.returncode}: {done.stdout[-300:]} {done.stderr[-1000:]}"

    def printed_json(self, words: list[str], schema: str, codes: set[int]) -> str:
        """The same, for a command that prints one JSON object of a schema."""
        return self.ended(words, codes, json.dumps({"schema": f"distalock/{schema}/1"}, separators=(",", ":"))[:-1])


if __name__ == "__main__":
    sys.exit(main())

"""`distalock robot workspace`: where the guide can be brought, and how far it can be turned there, as a drawing."""

import argparse
import sys
import time
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from distalock.arguments import EXIT_BAD_INPUT
from distalock.outputs import require_apart, write_whole
from shared.errors import InputError
from shared.geometry.hexapod import HexapodPart
from shared.geometry.hexapod_workspace import UNREACHABLE, WorkspaceMap, workspace_map
from shared.parts.files import read_part_file
from shared.parts.hexapod_file import hexapod_from_json

REACH_MM: Final = 18.0
HEIGHT_MM: Final = 10.0
STEP_MM: Final = 1.0
ANGLES_DEG: Final = np.array([1.5, 3.0, 4.5, 6.0])
DIRECTIONS: Final = 10
_PIXELS_PER_MM: Final = 14
_MARGIN_PX: Final = 60
_TEXT: Final = (40, 40, 40)
# Blue, green, red; from "not at all" to "6 degrees about any axis".
_COLOURS: Final = {
    UNREACHABLE: (235, 235, 235),
    0.0: (181, 113, 69),
    1.5: (190, 170, 90),
    3.0: (120, 200, 140),
    4.5: (90, 215, 215),
    6.0: (60, 160, 245),
}
_MEANINGS: Final = {UNREACHABLE: "out of reach", 0.0: "level only"}


def map_of(hexapod: HexapodPart, head_extension_mm: float) -> WorkspaceMap:
    """The map of about a million poses, for displacements of the guide's centre and rotations about it."""
    sideways = np.arange(-REACH_MM, REACH_MM + 0.5 * STEP_MM, STEP_MM)
    upwards = np.arange(-HEIGHT_MM, HEIGHT_MM + 0.5 * STEP_MM, STEP_MM)
    centre_mm = hexapod.top_from_guide(head_extension_mm).translation_mm
    return workspace_map(hexapod, centre_mm, (sideways, sideways, upwards), ANGLES_DEG, DIRECTIONS)


def drawing(found: WorkspaceMap, title: str) -> NDArray[np.uint8]:
    """Three sections through the zero pose with a legend; an image of blue, green, red, shape (rows, columns, 3)."""
    middle = [len(axis) // 2 for axis in (found.x_mm, found.y_mm, found.z_mm)]
    tilt = found.free_tilt_deg
    panels = [
        _panel(tilt[:, :, middle[2]], "x distal", "y", found.x_mm, found.y_mm),
        _panel(tilt[:, middle[1], :], "x distal", "z away from bone", found.x_mm, found.z_mm),
        _panel(tilt[middle[0], :, :], "y", "z away from bone", found.y_mm, found.z_mm),
    ]
    height = max(panel.shape[0] for panel in panels)
    row = np.hstack([_at_height(panel, height) for panel in panels])
    canvas = np.full((height + 2 * _MARGIN_PX, row.shape[1], 3), 255, dtype=np.uint8)
    canvas[_MARGIN_PX : _MARGIN_PX + height] = row
    _write(canvas, title, (20, 35), 0.7)
    _legend(canvas, height + _MARGIN_PX + 20)
    return canvas


def _panel(
    tilt: NDArray[np.float64], across: str, up: str, across_mm: NDArray[np.float64], up_mm: NDArray[np.float64]
) -> NDArray[np.uint8]:
    cells = np.zeros((*tilt.T.shape, 3), dtype=np.uint8)
    for angle, colour in _COLOURS.items():
        cells[np.equal(tilt.T, angle)] = colour
    side = int(STEP_MM * _PIXELS_PER_MM)
    grown = np.kron(cells[::-1], np.ones((side, side, 1), dtype=np.uint8))
    rows, columns = grown.shape[:2]
    panel = np.full((rows + 2 * _MARGIN_PX, columns + 2 * _MARGIN_PX, 3), 255, dtype=np.uint8)
    panel[_MARGIN_PX : _MARGIN_PX + rows, _MARGIN_PX : _MARGIN_PX + columns] = grown
    for at_mm in range(int(across_mm[0]) // 5 * 5 + 5, int(across_mm[-1]) + 1, 5):
        column = _MARGIN_PX + int((at_mm - across_mm[0] + 0.5) * _PIXELS_PER_MM)
        cv2.line(panel, (column, _MARGIN_PX + rows), (column, _MARGIN_PX + rows + 6), _TEXT, 1)
        _write(panel, f"{at_mm}", (column - 10, _MARGIN_PX + rows + 22), 0.45)
    for at_mm in range(int(up_mm[0]) // 5 * 5 + 5, int(up_mm[-1]) + 1, 5):
        row = _MARGIN_PX + rows - int((at_mm - up_mm[0] + 0.5) * _PIXELS_PER_MM)
        cv2.line(panel, (_MARGIN_PX - 6, row), (_MARGIN_PX, row), _TEXT, 1)
        _write(panel, f"{at_mm}", (_MARGIN_PX - 38, row + 5), 0.45)
    _write(panel, f"{across} (mm)", (_MARGIN_PX + columns // 2 - 40, _MARGIN_PX + rows + 44), 0.5)
    _write(panel, f"{up} (mm)", (_MARGIN_PX, _MARGIN_PX - 14), 0.5)
    return panel


def _at_height(panel: NDArray[np.uint8], height: int) -> NDArray[np.uint8]:
    whole = np.full((height, *panel.shape[1:]), 255, dtype=np.uint8)
    whole[: panel.shape[0]] = panel
    return whole


def _legend(canvas: NDArray[np.uint8], row: int) -> None:
    column = 20
    for angle, colour in _COLOURS.items():
        words = _MEANINGS.get(angle, f"any turn to {angle:g} deg")
        cv2.rectangle(canvas, (column, row - 14), (column + 24, row + 4), colour, -1)
        cv2.rectangle(canvas, (column, row - 14), (column + 24, row + 4), _TEXT, 1)
        _write(canvas, words, (column + 32, row), 0.5)
        column += 60 + 9 * len(words)


def _write(canvas: NDArray[np.uint8], words: str, place: tuple[int, int], size: float) -> None:
    cv2.putText(canvas, words, place, cv2.FONT_HERSHEY_SIMPLEX, size, _TEXT, 1, cv2.LINE_AA)


def run(given: argparse.Namespace) -> int:
    """Draw the map; 0, or 2 with one line on stderr."""
    try:
        hexapod = hexapod_from_json(read_part_file(given.hexapod), str(given.hexapod))
        require_apart(given.out, (given.hexapod,))
        begun = time.perf_counter()
        found = _map_or_refusal(hexapod, given.head_extension_mm)
        took_s = time.perf_counter() - begun
        title = f"{hexapod.name}, head at {given.head_extension_mm:g} mm: displacement of the guide's centre"
        write_whole(given.out, cv2.imencode(".png", drawing(found, title))[1].tobytes())
    except InputError as error:
        print(f"distalock robot workspace: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    volumes = ", ".join(f"{found.volume_mm3(a) / 1000:.2f} cm³ turned by up to {a:g}°" for a in ANGLES_DEG)
    print(f"{given.out}: {found.poses} poses in {took_s:.1f} s")
    print(f"reach of the guide's centre: {found.volume_mm3(0.0) / 1000:.2f} cm³ level, {volumes} about any axis")
    return 0


def _map_or_refusal(hexapod: HexapodPart, head_extension_mm: float) -> WorkspaceMap:
    try:
        return map_of(hexapod, head_extension_mm)
    except ValueError as error:
        raise InputError(str(error)) from None

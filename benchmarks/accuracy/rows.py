"""What came out for each scene, on file: a run goes on from it, and a later one takes its limits."""

from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from benchmarks.accuracy.localised_scenes import SceneRow
from shared.errors import InputError
from shared.json_lines import json_lines


@dataclass(frozen=True, slots=True)
class StoredRow:
    """A row with the revision of the sources that made it.

    Attributes
    ----------
    limits_revision
        Of the sources that worked out its limits, where these were taken from an earlier run; None where they are of
        the row's own revision, or there are none.
    """

    revision: str
    row: SceneRow
    limits_revision: str | None = None

    @property
    def sources(self) -> tuple[str, ...]:
        """What a report has to name."""
        return (self.revision, *([f"limits of {self.limits_revision}"] if self.limits_revision else []))


_STORED = TypeAdapter(StoredRow)


def write_row(file: Path, row: StoredRow) -> None:
    """Append a row, on a line of its own even after a line that was cut off."""
    cut_off = file.exists() and not file.read_bytes().endswith(b"\n")
    with file.open("a") as lines:
        lines.write("\n" * cut_off + _STORED.dump_json(row).decode() + "\n")


def read_rows(file: Path) -> list[StoredRow]:
    """Rows that are there; a line that was cut off in the middle is left out."""
    if not file.exists():
        return []
    rows, others = [], []
    for line in json_lines(file.read_text()):
        try:
            rows.append(_STORED.validate_json(line))
        except ValidationError:
            others.append(line)
    if others:
        print(f"{file}: {len(others)} lines are no rows and left out; the first: {others[0][:60]}", flush=True)
    return rows


class EarlierLimits:
    """Limits by seed, of an earlier run.

    Raises
    ------
    InputError
        When the run worked out none.
    """

    def __init__(self, file: Path | None) -> None:
        rows = read_rows(file) if file is not None else []
        self._rows = {one.row.seed: one for one in rows if one.row.limits}
        if file is not None and not self._rows:
            raise InputError(
                f"{file}: none of its {len(rows)} rows has limits; name the rows of a run that worked some out"
            )

    @property
    def seeds(self) -> frozenset[int]:
        """Scenes whose limits are there."""
        return frozenset(self._rows)

    def added_to(self, one: StoredRow) -> StoredRow:
        """A row with the limits of its scene, if it has none of its own and they are there.

        Raises
        ------
        InputError
            When the earlier run had something else at this seed.
        """
        earlier = self._rows.get(one.row.seed)
        if earlier is None or one.row.limits:
            return one
        if earlier.row.kind != one.row.kind:
            raise InputError(
                f"seed {one.row.seed} was another scene when the limits were worked out ({earlier.row.kind}, today "
                f"{one.row.kind}); leave out --limits, or give a run of today's scenes"
            )
        row = replace(one.row, limits=earlier.row.limits)
        return replace(one, row=row, limits_revision=earlier.limits_revision or earlier.revision)

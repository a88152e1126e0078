"""Which part files may be used: each approved once, by its hash, by an administrator; a line each in the state folder.

Parts of the catalogue come with the package and need no approval. A file that came another way decides where the guide
goes, and nothing in an image shows that its holes are not where it says.
"""

import os
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Final

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from shared.errors import ConfigurationError
from shared.json_lines import json_lines
from shared.parts.lengths import MeasuredLength

APPROVALS_FILE: Final = "approved-parts.jsonl"


class Approval(BaseModel):
    """Who has approved which file, and when."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sha256: str = Field(pattern=r"^[0-9a-f]{64}$", description="The part's (`shared.parts.canonical`).")
    schema_name: str = Field(max_length=64)
    file_name: str = Field(max_length=255)
    approved_by: str = Field(min_length=1, max_length=128)
    approved_at: AwareDatetime
    length: MeasuredLength | None = Field(
        default=None, description="Of a ring or guide; lines without one are older than the rule."
    )


class PartApprovals:
    """The file of approvals; it only ever grows.

    Parameters
    ----------
    state_dir
        State folder of the installation.
    """

    def __init__(self, state_dir: Path) -> None:
        self._file = state_dir / APPROVALS_FILE

    def all(self) -> tuple[Approval, ...]:
        """The approvals, the oldest first; raises `ConfigurationError` when the file cannot be read."""
        try:
            lines = json_lines(self._file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return ()
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigurationError(f"{self._file} cannot be read: {error}") from None
        return tuple(self._approval(line, number) for number, line in enumerate(lines, 1))

    def holds(self, sha256: str) -> bool:
        """Whether a file is approved; raises as `all`."""
        return any(approval.sha256 == sha256 for approval in self.all())

    def add(self, approval: Approval) -> None:
        """Write an approval to the disk; raises `ConfigurationError` when it does not take it."""
        line = approval.model_dump_json() + "\n"
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with os.fdopen(os.open(self._file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), "w") as file:
                file.write(line)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise ConfigurationError(f"{self._file} cannot be written: {error.strerror or error}") from None

    def _approval(self, line: str, number: int) -> Approval:
        try:
            return Approval.model_validate_json(line)
        except ValidationError:
            raise ConfigurationError(
                f"{self._file}, line {number} is no approval; put back what was there, or approve the files anew after "
                "removing it"
            ) from None


def approval_of(
    part: Mapping[str, object],
    sha256: str,
    file_name: str,
    who: str,
    now: datetime,
    length: MeasuredLength | None = None,
) -> Approval:
    """An approval that is given now."""
    return Approval(
        sha256=sha256,
        schema_name=str(part.get("schema", "")),
        file_name=file_name,
        approved_by=who,
        approved_at=now,
        length=length,
    )

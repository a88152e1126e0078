"""`docs/risk/fmea.md`: how each step of the procedure may fail, how that is noticed, how often it was simulated."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field, TypeAdapter
from typing_extensions import TypedDict

from tools.risk.files import FOLDER, FailureMode, entries
from tools.risk.tables import NOT_A_DEVICE, table

CAMPAIGN: Final = FOLDER / "campaign.json"
_HEAD: Final = f"""{NOT_A_DEVICE} This page is printed by `make generated` from `fmea.yaml` and `campaign.json`.
For each step of the [procedure](../procedure.md): how it may fail, what that does, which [hazard](hazards.md) it leads
to, how it is noticed, and how often that was in the simulated procedures of the
[campaign](../benchmarks/campaign.md). *Tried*: in so many procedures the failure was brought about on purpose, and how
these ended. *Said*: in so many procedures one of the codes was said at least once, whatever brought it about. Codes are
explained in [refusals](../refusals.md) and [procedure](../procedure.md#why-not)."""


class _StepCounts(TypedDict):
    procedures: int
    codes: dict[str, int]


class CampaignCounts(TypedDict):
    """What `distalock bench campaign` leaves: procedures, and how those ended in which something was tried or said."""

    procedures: Annotated[int, Field(ge=1)]
    endings: dict[str, int]
    errors: dict[str, dict[str, int]]
    faults: dict[str, dict[str, int]]
    codes: dict[str, int]
    steps: dict[str, _StepCounts]


def fmea_page() -> str:
    """The page."""
    counts = campaign_counts()
    rows = (_row(mode, counts) for mode in entries(FOLDER / "fmea.yaml", FailureMode))
    heads = ("step", "failure", "effect", "hazard", "how it is noticed", "codes", "in the campaign")
    return "\n".join(["# Failure modes and effects", "", _HEAD, "", _of(counts), "", *table(heads, rows), ""])


def campaign_counts(file: Path = CAMPAIGN) -> CampaignCounts | None:
    """The campaign's counts; None when there was none."""
    if not file.exists():
        return None
    return TypeAdapter(CampaignCounts).validate_python(json.loads(file.read_text(encoding="utf-8")))


def _of(counts: CampaignCounts | None) -> str:
    if counts is None:
        return "There was no campaign yet: `distalock bench campaign`."
    return f"{counts['procedures']} procedures: {_endings(counts['endings'])}."


def _row(mode: FailureMode, counts: CampaignCounts | None) -> Iterable[str]:
    codes = ", ".join(f"`{code}`" for code in mode.codes) or "none"
    hazard = f"[{mode.hazard}](hazards.md#{mode.hazard.lower()})"
    often = "-" if counts is None else _often(mode, counts)
    return f"`{mode.step}`", mode.failure, mode.effect, hazard, mode.noticed, codes, often


def _often(mode: FailureMode, counts: CampaignCounts) -> str:
    tried: dict[str, int] = {}
    for name in mode.tried:
        for ending, count in (counts["errors"] | counts["faults"]).get(name, {}).items():
            tried[ending] = tried.get(ending, 0) + count
    said = {code: counts["codes"][code] for code in mode.codes if code in counts["codes"]}
    parts = [f"tried {sum(tried.values())}: {_endings(tried)}"] if tried else []
    parts += ["said: " + ", ".join(f"`{code}` {count}" for code, count in said.items())] if said else []
    return "; ".join(parts) or "not seen"


def _endings(endings: Mapping[str, int]) -> str:
    return ", ".join(f"{ending} {count}" for ending, count in sorted(endings.items()))

"""The YAML files of `docs/risk`, read strictly."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, Self, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from shared.errors import InputError
from tools.risk.evidence import ROOT
from tools.risk.scales import Acceptance, Probability, Severity, acceptance

FOLDER: Final = ROOT / "docs" / "risk"
R = TypeVar("R", bound=BaseModel)
Sentence = Annotated[str, Field(min_length=4)]
RequirementId = Annotated[str, Field(pattern=r"^[A-Z]{2,3}-\d\d$")]
TestName = Annotated[str, Field(pattern=r"^test_\w+$")]


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class Requirement(_Entry):
    """What the software must do for safety.

    Attributes
    ----------
    item
        Software item that does it.
    kind
        How it controls a risk (ISO 14971, 7.1).
    page
        Where it is described, relative to `docs`.
    """

    id: RequirementId
    item: str
    kind: Literal["design", "protection", "information"]
    text: Sentence
    page: str


class Control(_Entry):
    """A requirement that controls a hazard, and the tests that show it against the hazard's sequence."""

    requirement: RequirementId
    shown_by: Annotated[tuple[TestName, ...], Field(min_length=1)]


class Hazard(_Entry):
    """A hazard with its sequence of events, harm, estimates and controls.

    Attributes
    ----------
    before, after
        Probability of the harm in one procedure without and with the controls.
    left
        What no software controls; empty when nothing is known.
    """

    id: Annotated[str, Field(pattern=r"^H\d\d$")]
    hazard: Sentence
    sequence: Annotated[tuple[Sentence, ...], Field(min_length=2)]
    harm: Sentence
    severity: Severity
    before: Probability
    after: Probability
    controls: Annotated[tuple[Control, ...], Field(min_length=1)]
    left: str = ""

    @property
    def residual(self) -> Acceptance:
        """What follows from what remains."""
        return acceptance(self.severity, self.after)

    @model_validator(mode="after")
    def _controls_do_not_add_risk(self) -> Self:
        order = list(Probability)
        if order.index(self.after) > order.index(self.before):
            raise ValueError(f"probability after the controls ({self.after}) is above that before ({self.before})")
        return self


class FailureMode(_Entry):
    """How a step of the procedure may fail.

    Attributes
    ----------
    step
        An action of the procedure's table, or a step that people report.
    noticed
        How; `codes` are what the system says then.
    tried
        Errors and faults of the campaign that bring it about.
    """

    step: str
    failure: Sentence
    effect: Sentence
    hazard: Annotated[str, Field(pattern=r"^H\d\d$")]
    noticed: Sentence
    codes: tuple[str, ...]
    tried: tuple[str, ...] = ()


class ThirdParty(_Entry):
    """A package of others: what for, what a defect could do, and what would show it."""

    name: str
    items: tuple[str, ...]
    does: Sentence
    wrong: Sentence
    shown: Sentence


class UseError(_Entry):
    """What people may do wrong at the console or with their hands (IEC 62366-1).

    Attributes
    ----------
    answer
        What the system does then.
    shown_by
        Tests that carry the mark of one of the hazard's requirements; none where the system can know nothing of it.
    """

    id: Annotated[str, Field(pattern=r"^U\d\d$")]
    task: str
    error: Sentence
    hazard: Annotated[str, Field(pattern=r"^H\d\d$")]
    answer: Sentence
    shown_by: tuple[TestName, ...]


class SoftwareItem(_Entry):
    """A software item with its safety class (IEC 62304, 4.3)."""

    id: str
    name: str
    paths: tuple[str, ...]
    safety_class: Annotated[Literal["A", "B", "C"], Field(alias="class")]
    does: Sentence
    why: Sentence


@dataclass(frozen=True, slots=True)
class RiskFile:
    """All of the folder that has to agree."""

    hazards: tuple[Hazard, ...]
    requirements: tuple[Requirement, ...]
    items: tuple[SoftwareItem, ...]
    use_errors: tuple[UseError, ...] = ()


def load_risk_file(folder: Path = FOLDER) -> RiskFile:
    """Read the files.

    Raises
    ------
    InputError
        When one is missing, or an entry is not what it should be.
    """
    return RiskFile(
        entries(folder / "hazards.yaml", Hazard),
        entries(folder / "requirements.yaml", Requirement),
        entries(folder / "software.yaml", SoftwareItem),
        entries(folder / "use-errors.yaml", UseError),
    )


def entries(file: Path, kind: type[R]) -> tuple[R, ...]:
    """Entries of one file; strict as JSON is, so that a number is no text.

    Raises
    ------
    InputError
        When the file is missing, or an entry is not what it should be.
    """
    try:
        content = json.dumps(yaml.safe_load(file.read_text(encoding="utf-8")))
        return TypeAdapter(tuple[kind, ...]).validate_json(content)  # type: ignore[valid-type]
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(f"{file.name}: entry {place}: {first['msg']}") from None
    except (OSError, TypeError, yaml.YAMLError) as error:
        raise InputError(f"{file}: cannot be read: {error}") from None

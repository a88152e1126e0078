"""Pages of the risk file, printed from its YAML files and the marks of tests: hazards, requirements, software items."""

from collections.abc import Iterator
from typing import Final

from tools.risk.evidence import MarkedTest, marked_tests
from tools.risk.files import Hazard, Requirement, RiskFile, SoftwareItem, load_risk_file
from tools.risk.scales import (
    ACCEPTANCE_MEANS,
    PROBABILITY_MEANS,
    SEVERITY_MEANS,
    Acceptance,
    Probability,
    Severity,
    acceptance,
)
from tools.risk.tables import NOT_A_DEVICE, table

_PRINTED: Final = "This page is printed by `make generated` from `{}`."
_HAZARDS_HEAD: Final = f"""{NOT_A_DEVICE} {_PRINTED.format("hazards.yaml")} After ISO 14971: what may harm, by which
sequence of events, how severely, how probably without and with the controls, and which tests show each control.
`distalock risk check`, the last step of `make test`, fails when a control has no test that ran on these sources and
passed. Probabilities are the authors' estimates: nothing here was used on a patient, and a thousand simulated
procedures without harm exclude no more than 3 in 1,000 (95 %). How often steps failed in simulated procedures is in
[fmea.md](fmea.md)."""
_REQUIREMENTS_HEAD: Final = f"""{NOT_A_DEVICE} {_PRINTED.format("requirements.yaml")} What the software must do for
safety (IEC 62304, 5.2.3), which hazards it controls, and every test that carries its mark
(`@pytest.mark.requirement("ROB-02")`). Kinds after ISO 14971, 7.1: *design* is inherently safe, *protection* is a
protective measure, *information* tells people."""
_SOFTWARE_HEAD: Final = f"""{NOT_A_DEVICE} {_PRINTED.format("software.yaml")} Classes after IEC 62304, 4.3: A no
injury, B non-serious, C serious injury possible. An item within the folder of another has its own class. Which layers
may import which is checked by import-linter (`pyproject.toml`)."""
_USE_HEAD: Final = f"""{NOT_A_DEVICE} {_PRINTED.format("use-errors.yaml")} After IEC 62366-1: what people may do wrong
at each task, what comes of it, and what the system does. The tests carry marks of [requirements](requirements.md), and
are part of the check. How often each was survived in simulated procedures is in [fmea.md](fmea.md)."""


def hazards_page() -> str:
    """`docs/risk/hazards.md`."""
    risk = load_risk_file()
    text = {one.id: one.text for one in risk.requirements}
    return "\n".join(
        [
            "# Hazards",
            "",
            _HAZARDS_HEAD,
            "",
            *_scales(),
            "",
            "## All at a glance",
            "",
            *table(
                ("", "hazard", "severity", "before", "after", "what follows", "controls"),
                (_line(hazard) for hazard in risk.hazards),
            ),
            "",
            "## One by one",
            *(line for hazard in risk.hazards for line in _section(hazard, text)),
            "",
        ]
    )


def _scales() -> Iterator[str]:
    yield "## Scales"
    yield ""
    head = ("severity", "means", *Probability)
    rows = ((s, SEVERITY_MEANS[s], *(acceptance(s, p) for p in Probability)) for s in reversed(Severity))
    yield from table(head, rows)
    yield ""
    yield "; ".join(f"*{p}*: {PROBABILITY_MEANS[p]}" for p in Probability) + "."
    yield "; ".join(f"*{a}*: {ACCEPTANCE_MEANS[a]}" for a in Acceptance) + "."


def _line(hazard: Hazard) -> tuple[str, ...]:
    name = f"[{hazard.hazard}](#{hazard.id.lower()})"
    controls = ", ".join(_link(c.requirement) for c in hazard.controls)
    return (hazard.id, name, hazard.severity, hazard.before, hazard.after, hazard.residual, controls)


def _section(hazard: Hazard, text: dict[str, str]) -> Iterator[str]:
    yield ""
    yield f"### {hazard.id}"
    yield ""
    yield f"**{hazard.hazard}.** Harm: {_lower(hazard.harm)} ({hazard.severity}). Without controls {hazard.before}: "
    yield f"{acceptance(hazard.severity, hazard.before)}. With them {hazard.after}: {hazard.residual}."
    yield ""
    yield from (f"{number}. {event}." for number, event in enumerate(hazard.sequence, 1))
    yield ""
    rows = (
        (_link(c.requirement), text.get(c.requirement, ""), ", ".join(f"`{name}`" for name in c.shown_by))
        for c in hazard.controls
    )
    yield from table(("control", "", "shown by"), rows)
    if hazard.left:
        yield ""
        yield f"What is left: {hazard.left}"


def requirements_page() -> str:
    """`docs/risk/requirements.md`."""
    risk, tests = load_risk_file(), marked_tests()
    return "\n".join(
        [
            "# Requirements and the tests that show them",
            "",
            _REQUIREMENTS_HEAD,
            *(line for item in risk.items for line in _requirements_of(item, risk, tests)),
            "",
        ]
    )


def _requirements_of(item: SoftwareItem, risk: RiskFile, tests: tuple[MarkedTest, ...]) -> Iterator[str]:
    own = [one for one in risk.requirements if one.item == item.id]
    if not own:
        return
    yield ""
    yield f"## {item.name}"
    for one in own:
        hazards = [h.id for h in risk.hazards if any(c.requirement == one.id for c in h.controls)]
        controls = ", ".join(f"[{name}](hazards.md#{name.lower()})" for name in hazards)
        yield ""
        yield f"### {one.id}"
        yield ""
        yield f"{one.text} ({one.kind}; described in {_page(one)}; controls {controls})"
        yield ""
        yield from (f"- `{test.file}::{test.name}`" for test in tests if one.id in test.requirements)


def software_page() -> str:
    """`docs/risk/software.md`."""
    items = load_risk_file().items
    rows = (
        (one.name, one.safety_class, ", ".join(f"`{path}`" for path in one.paths), one.does, one.why) for one in items
    )
    return "\n".join(
        [
            "# Software items and their classes",
            "",
            _SOFTWARE_HEAD,
            "",
            *table(("item", "class", "sources", "does", "why this class"), rows),
            "",
        ]
    )


def _link(requirement: str) -> str:
    return f"[{requirement}](requirements.md#{requirement.lower()})"


def _page(requirement: Requirement) -> str:
    return f"[{requirement.page.partition('#')[0]}](../{requirement.page})"


def _lower(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]


def use_errors_page() -> str:
    """`docs/risk/use-errors.md`."""
    rows = (
        (
            one.id,
            one.task,
            one.error,
            f"[{one.hazard}](hazards.md#{one.hazard.lower()})",
            one.answer,
            ", ".join(f"`{name}`" for name in one.shown_by) or "nothing: the system cannot know",
        )
        for one in load_risk_file().use_errors
    )
    heads = ("", "task", "error", "hazard", "what the system does", "shown by")
    return "\n".join(["# Use errors", "", _USE_HEAD, "", *table(heads, rows), ""])

"""Links between operations: which answer leads to which next request, with what of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from services.ui_api.api_document.operations import JsonObject, Operation, operations


@dataclass(frozen=True, slots=True)
class Link:
    """From the good answer of one operation to another.

    Attributes
    ----------
    parameters
        What the next request takes: parameter, and the runtime expression that gives it.
    body
        Members of the next body, each from a runtime expression or as it is.
    """

    source: str
    target: str
    says: str
    parameters: Mapping[str, str] = field(default_factory=dict)
    body: Mapping[str, object] = field(default_factory=dict)


_CASE: Final = {"case_id": "$request.path.case_id"}
_NEW_CASE: Final = {"case_id": "$response.body#/id"}
_CASE_TAG: Final = {"If-Match": "$response.header.Case-ETag"}
_NUMBER: Final = {"number": "$response.body#/number"}
_FIRST: Final = {"number": "$response.body#/items/0/number"}
_OPERATION: Final = {"operation_id": "$response.body#/id"}
_ABOUT_CASE: Final = (
    ("read_case", "its procedure, and the ETag that a change quotes"),
    ("list_images", "images that have arrived"),
    ("read_alignment", "how to turn the C-arm"),
    ("read_timeline", "what happened"),
    ("case_events", "what happens, as it happens"),
)
_CHANGES: Final = (
    ("change_case", "change the set-up"),
    ("record_step", "record what people did with their hands"),
    ("make_plan", "plan from a localisation"),
    ("begin_motion", "begin the motion of the approved plan"),
    ("make_verification", "compare wires or guide with the axes"),
    ("make_qa_report", "report on images"),
    ("begin_computation", "verify, report or plan without waiting for it"),
)
_LISTS: Final = ("localisation", "plan", "verification", "qa_report")

LINKS: Final = (
    *(Link("open_case", target, says, _NEW_CASE) for target, says in _ABOUT_CASE),
    *(Link("read_case", target, says, _NEW_CASE) for target, says in _ABOUT_CASE if target != "read_case"),
    *(
        Link(source, target, says, _NEW_CASE | _CASE_TAG)
        for source in ("open_case", "read_case", "record_step", "change_case")
        for target, says in _CHANGES
    ),
    Link("read_case", "list_steps", "steps that were recorded", _NEW_CASE),
    Link("list_cases", "read_case", "the first of them", {"case_id": "$response.body#/items/0/id"}),
    Link("list_steps", "withdraw_step", "take back the one that was recorded first", _CASE | _FIRST),
    Link("list_images", "read_image", "the first of them", {"image_id": "$response.body#/items/0/id"}),
    Link("list_images", "read_png", "its picture", {"image_id": "$response.body#/items/0/id"}),
    Link("read_image", "read_png", "its picture", {"image_id": "$response.body#/id"}),
    Link("read_image", "read_dicom", "its file", {"image_id": "$response.body#/id"}),
    Link(
        "read_image",
        "read_localisation",
        "what it said",
        {"case_id": "$response.body#/case_id", "number": "$response.body#/localisation"},
    ),
    Link("read_alignment", "read_localisation", "what it rests on", _CASE | {"number": "$response.body#/localisation"}),
    Link(
        "read_alignment",
        "read_png",
        "its picture, with what was found",
        {"image_id": "$response.body#/image", "view": "overlay"},
    ),
    *(Link(f"list_{kind}s", f"read_{kind}", "the first of them", _CASE | _FIRST) for kind in _LISTS),
    Link("make_plan", "read_plan", "read what is to be approved", _CASE | _NUMBER),
    Link(
        "make_plan",
        "approve_plan",
        "approve exactly this plan",
        _CASE | _NUMBER | {"If-Match": "$response.header.ETag"},
    ),
    Link(
        "read_plan",
        "approve_plan",
        "approve exactly this plan",
        _CASE | _NUMBER | {"If-Match": "$response.header.ETag"},
    ),
    Link("approve_plan", "withdraw_approval", "take the approval back", _CASE | {"number": "$response.body#/plan"}),
    Link("approve_plan", "begin_motion", "begin its motion", _CASE | _CASE_TAG, {"plan": "$response.body#/plan"}),
    Link("begin_motion", "read_operation", "how far it has come", _OPERATION),
    Link("begin_motion", "renew_lease", "go on holding", _OPERATION),
    Link("begin_computation", "read_operation", "how far it has come", _OPERATION),
    Link("begin_computation", "cancel_operation", "wait for it no more", _OPERATION),
    *(
        Link(source, "read_operation", "how far it has come", _OPERATION)
        for source in ("reference_robot", "acknowledge_stop", "reset_robot")
    ),
    Link(
        "read_image",
        "read_operation",
        "how far its localisation has come",
        {"operation_id": "$response.body#/operation"},
    ),
    Link("list_operations", "read_operation", "the first of them", {"operation_id": "$response.body#/items/0/id"}),
    Link("make_verification", "read_verification", "read it again", _CASE | _NUMBER),
    Link("make_qa_report", "read_qa_report", "read it again", _CASE | _NUMBER),
    Link("make_qa_report", "read_qa_page", "as a page", _CASE | _NUMBER),
    Link("list_parts", "read_part", "the first of them", {"name": "$response.body#/0/name"}),
    Link(
        "sign_in", "refresh_session", "go on being signed in", body={"refresh_token": "$response.body#/refresh_token"}
    ),
    Link("sign_in", "read_me", "who is signed in"),
    Link("sign_in", "sign_out", "end the session"),
    *(
        Link("create_user", target, says, {"name": "$response.body#/name"})
        for target, says in (
            ("read_user", "read it"),
            ("change_user", "change it"),
            ("end_sessions", "end its sessions"),
        )
    ),
    Link("list_users", "read_user", "the first of them", {"name": "$response.body#/items/0/name"}),
)


def add_links(document: JsonObject) -> None:
    """Write each link into the good answers of its source."""
    by_name = {operation.name: operation for operation in operations(document)}
    for link in LINKS:
        for answer in by_name[link.source].good_answers.values():
            links = answer.setdefault("links", {})
            assert isinstance(links, dict)
            links[link.target] = _described(link, by_name[link.target])


def _described(link: Link, target: Operation) -> JsonObject:
    described: JsonObject = {"operationId": link.target, "description": link.says}
    if link.parameters:
        described["parameters"] = {_place(target, name): value for name, value in link.parameters.items()}
    return described | ({"requestBody": dict(link.body)} if link.body else {})


def _place(target: Operation, name: str) -> str:
    """A parameter with the place where it stands, as in `path.case_id`."""
    for place in ("path", "query", "header"):
        found = target.parameter(place, name)
        if found is not None:
            return f"{place}.{found['name']}"
    raise ValueError(f"{target.name} has no parameter {name!r}")

"""Which headers answers carry, and whose ETag a change quotes."""

import re
from typing import Final

from services.ui_api.api_document.operations import JsonObject, Operation, operations

MATCHES_KEY: Final = "x-distalock-if-match"
_CASE: Final = re.compile(r"^/api/v1/cases/\{case_id\}")
_APPROVAL: Final = "/approval"
_MAKING: Final = frozenset({"open_case", "make_plan", "make_verification", "make_qa_report", "create_user"})


def add_etags(document: JsonObject) -> None:
    """Name the headers of each answer, and in `x-distalock-if-match` the resource whose ETag a change quotes."""
    for operation in operations(document):
        matched = matched_path(operation)
        if matched is not None:
            operation.described[MATCHES_KEY] = matched
        for status, answer in operation.good_answers.items():
            headers = _headers(operation, status)
            if headers:
                answer["headers"] = {
                    name: {"description": says, "schema": {"type": "string"}} for name, says in headers.items()
                }


def matched_path(operation: Operation) -> str | None:
    """Path of the resource whose ETag an operation quotes in `If-Match`; None when it quotes none."""
    if operation.parameter("header", "If-Match") is None:
        return None
    if operation.path.endswith(_APPROVAL):
        return operation.path.removesuffix(_APPROVAL)
    case = _CASE.match(operation.path)
    assert case is not None, f"{operation.path} needs If-Match and belongs to no case"
    return case[0]


def _headers(operation: Operation, status: str) -> dict[str, str]:
    found = {}
    is_stream = "text/event-stream" in str(operation.good_answers)
    if operation.method == "get" and not is_stream:
        found["ETag"] = "Of what is answered; for If-None-Match, and of a case or a plan for If-Match."
    if operation.name == "make_plan":
        found["ETag"] = "Of the plan; its approval quotes it."
    changes_case = operation.method in ("post", "patch") and _CASE.match(operation.path) is not None
    if changes_case or operation.name in ("open_case", "read_case", "withdraw_step"):
        found["Case-ETag"] = "Of the case from now on; the next change quotes it."
    if status == "202" or operation.name in _MAKING:
        found["Location"] = "Path of what was made."
    return found

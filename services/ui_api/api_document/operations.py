"""The operations of an OpenAPI document, as those who add to it need them."""

from collections.abc import Iterator
from dataclasses import dataclass

JsonObject = dict[str, object]


@dataclass(frozen=True, slots=True)
class Operation:
    """One operation: where it stands, and its part of the document, which may be added to."""

    method: str
    path: str
    described: JsonObject

    @property
    def name(self) -> str:
        """Its `operationId`."""
        return str(self.described["operationId"])

    def parameter(self, place: str, name: str) -> JsonObject | None:
        """A parameter by place (`header`, `query`, `path`) and name; None when there is none."""
        parameters = self.described.get("parameters", [])
        assert isinstance(parameters, list)
        found = (one for one in parameters if one["in"] == place and one["name"].lower() == name.lower())
        return next(found, None)

    def answer(self, status: str) -> JsonObject:
        """What is answered with a status."""
        responses = self.described["responses"]
        assert isinstance(responses, dict)
        answer = responses[status]
        assert isinstance(answer, dict)
        return answer

    @property
    def good_answers(self) -> dict[str, JsonObject]:
        """What is answered when all goes well, by status."""
        responses = self.described["responses"]
        assert isinstance(responses, dict)
        return {status: answer for status, answer in responses.items() if status.startswith("2")}


def operations(document: JsonObject) -> Iterator[Operation]:
    """Every operation of a document."""
    paths = document["paths"]
    assert isinstance(paths, dict)
    for path, methods in paths.items():
        for method, described in methods.items():
            yield Operation(method, path, described)

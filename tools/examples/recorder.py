"""Keeps what was sent and answered, by operation."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import httpx

from tools.examples.normalise import Normaliser

JsonObject = dict[str, object]
_JSON: Final = "application/json"


@dataclass(slots=True)
class Recorder:
    """Hooks of an HTTP client: the first good answer of each operation is its example.

    Attributes
    ----------
    document
        The OpenAPI document, whose paths tell which operation a request is of.
    """

    document: JsonObject
    examples: dict[str, JsonObject] = field(default_factory=dict)
    _normaliser: Normaliser = field(default_factory=Normaliser)

    def on_answer(self, response: httpx.Response) -> None:
        """Keep an answer with its request."""
        if "event-stream" in response.headers.get("content-type", ""):
            return
        response.read()
        found = self._operation(response.request.method.lower(), response.request.url.path)
        if found is None or found[0] in self.examples or not response.is_success:
            if response.is_error and "current" in response.text:
                self.examples.setdefault("problem", {"answer": self._json(response.content)})
            return
        name, path = found
        kept: JsonObject = {"path": {key: self._normaliser.text(value) for key, value in path.items()}}
        if response.request.content:
            kept["body"] = self._json(response.request.content)
        if response.headers.get("content-type", "").startswith(_JSON):
            kept["answer"] = self._json(response.content)
        self.examples[name] = kept

    def keep_stream(self, name: str, path: Mapping[str, str], lines: list[str]) -> None:
        """Keep the beginning of a stream of events."""
        kept = [self._line(line) for line in lines]
        placed = {key: self._normaliser.text(value) for key, value in path.items()}
        self.examples[name] = {"path": placed, "answer": "\n".join(kept) + "\n"}

    def _line(self, line: str) -> str:
        if not line.startswith("data: "):
            return line
        return "data: " + json.dumps(self._json(line.removeprefix("data: ").encode()), separators=(",", ":"))

    def _json(self, content: bytes) -> object:
        return self._normaliser.value(json.loads(content))

    def _operation(self, method: str, path: str) -> tuple[str, dict[str, str]] | None:
        """The operation of a request and the parameters of its path; the most literal path of those that fit."""
        paths = self.document["paths"]
        assert isinstance(paths, dict)
        for template in sorted(paths, key=lambda one: -len(re.sub(r"\{\w+\}", "", one))):
            pattern = re.sub(r"\\\{(\w+)\\\}", r"(?P<\1>[^/]+)", re.escape(template))
            found = re.fullmatch(pattern, path)
            if found is not None and method in paths[template]:
                return str(paths[template][method]["operationId"]), found.groupdict()
        return None

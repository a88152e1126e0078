"""An answer as it comes over the line, and what a refusal in it says."""

from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus

from pydantic import ValidationError

from distalock.client.models import Problem
from distalock.client.refusals import RequestRefused

_PROBLEM = "application/problem+json"


@dataclass(frozen=True, slots=True)
class RawAnswer:
    """Status, headers (names in lower case) and content."""

    status: int
    headers: Mapping[str, str]
    content: bytes

    @property
    def is_not_modified(self) -> bool:
        """Whether nothing has changed since it was read."""
        return self.status == HTTPStatus.NOT_MODIFIED

    def refusal(self, path: str) -> RequestRefused | None:
        """The refusal that it is; None when all went well."""
        if self.status < HTTPStatus.BAD_REQUEST:
            return None
        after = self.headers.get("retry-after", "")
        return RequestRefused(
            self._problem(path),
            etag=self.headers.get("etag"),
            retry_after_s=float(after) if after.isdigit() else None,
            status=self.status,
        )

    def _problem(self, path: str) -> Problem:
        """The problem document, or one that says what came instead, as from a proxy in between."""
        if self.headers.get("content-type", "").startswith(_PROBLEM):
            try:
                return Problem.model_validate_json(self.content)
            except ValidationError:
                pass
        phrase = HTTPStatus(self.status).phrase if self.status in set(HTTPStatus) else "refused"
        text = self.content[:200].decode(errors="replace")
        detail = f"{self.status} {phrase}, without a problem document: {text}" if text else f"{self.status} {phrase}"
        return RequestRefused.of(self.status, "unknown", detail, path).problem

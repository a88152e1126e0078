"""A thin client of the REST gateway and of the virtual room: JSON in, JSON out, problems as exceptions."""

import time
import uuid
from collections.abc import Mapping
from types import TracebackType
from typing import Self

import httpx

from shared.errors import DistalockError

JsonObject = dict[str, object]
_PATIENCE_S = 60.0
_POLL_S = 0.1


class RequestRefused(DistalockError):
    """The server answered with a problem document.

    Attributes
    ----------
    status
        HTTP status.
    problem_code
        Stable code of the problem.
    """

    code = "request_refused"

    def __init__(self, status: int, problem_code: str, detail: str) -> None:
        super().__init__(detail)
        self.status = status
        self.problem_code = problem_code


class RestClient:
    """Requests to one server, as a console would make them."""

    def __init__(self, base_url: str) -> None:
        self._http = httpx.Client(base_url=base_url, timeout=30.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._http.close()

    def get(self, path: str) -> JsonObject:
        """Fetch a resource."""
        return _content(self._http.get(path))

    def get_bytes(self, path: str) -> bytes:
        """Fetch a file."""
        response = self._http.get(path)
        if response.is_error:
            _content(response)
        return response.content

    def post(self, path: str, body: object = None, if_match: str | None = None) -> JsonObject:
        """Act, at most once: every call carries an idempotency key of its own."""
        headers = {"Idempotency-Key": str(uuid.uuid4()), **({"If-Match": if_match} if if_match else {})}
        return _content(self._http.post(path, json={} if body is None else body, headers=headers))

    def put(self, path: str, body: Mapping[str, object]) -> JsonObject:
        """Replace a resource."""
        return _content(self._http.put(path, json=body))

    def delete(self, path: str) -> JsonObject:
        """Remove a resource."""
        return _content(self._http.delete(path))

    def wait_for_operation(self, operation_id: str) -> JsonObject:
        """Follow an operation to its end.

        Raises
        ------
        TimeoutError
            When it has not ended within a minute.
        """
        deadline = time.monotonic() + _PATIENCE_S
        while time.monotonic() < deadline:
            operation = self.get(f"/api/v1/operations/{operation_id}")
            if operation["status"] not in ("running", "unknown"):
                return operation
            time.sleep(_POLL_S)
        raise TimeoutError(f"operation {operation_id} has not ended after {_PATIENCE_S:.0f} s")


def _content(response: httpx.Response) -> JsonObject:
    body = response.json() if response.content else {}
    if response.is_error:
        raise RequestRefused(
            response.status_code, str(body.get("code", "unknown")), str(body.get("detail") or response.reason_phrase)
        )
    if not isinstance(body, dict):
        raise TypeError(f"{response.url} answered with a JSON {type(body).__name__}, expected an object")
    return body

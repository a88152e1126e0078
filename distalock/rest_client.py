"""JSON in, JSON out, problems as exceptions: for the virtual room, and for who asks a gateway for what it refuses.

Programs that lead a case use `distalock.client`.
"""

import ssl
import uuid
from collections.abc import Mapping
from types import TracebackType
from typing import Self

import httpx

from distalock.client.refusals import RequestRefused

JsonObject = dict[str, object]


# The virtual room answers a shot when it is rendered and delivered: seconds, and minutes on a busy machine.
_ANSWER_S, _CONNECT_S = 300.0, 30.0


def bearer(token: str | None) -> dict[str, str]:
    """The header that says who asks; none without a token."""
    return {} if token is None else {"Authorization": f"Bearer {token}"}


class RestClient:
    """Requests to one server, as a console would make them.

    Parameters
    ----------
    token
        Says who asks; the virtual room asks for none.
    trusted
        Whose certificates count; by default those of the system's authorities.
    """

    def __init__(
        self,
        base_url: str,
        token: str | None = None,
        answer_s: float = _ANSWER_S,
        trusted: ssl.SSLContext | None = None,
    ) -> None:
        self._http = httpx.Client(
            verify=trusted or True,
            base_url=base_url,
            headers=bearer(token),
            timeout=httpx.Timeout(answer_s, connect=_CONNECT_S),
        )

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

    def etag(self, path: str) -> str:
        """The ETag of a resource as it is now; raises `RequestRefused`."""
        response = self._http.get(path)
        _content(response)
        return response.headers["etag"]

    def put(self, path: str, body: Mapping[str, object]) -> JsonObject:
        """Replace a resource."""
        return _content(self._http.put(path, json=body))

    def patch(self, path: str, body: Mapping[str, object], if_match: str | None = None) -> JsonObject:
        """Change a resource."""
        headers = {"If-Match": if_match} if if_match else {}
        return _content(self._http.patch(path, json=body, headers=headers))

    def delete(self, path: str) -> JsonObject:
        """Remove a resource."""
        return _content(self._http.delete(path))


def _content(response: httpx.Response) -> JsonObject:
    body = response.json() if response.content else {}
    if response.is_error:
        raise RequestRefused.of(
            response.status_code, str(body.get("code", "unknown")), str(body.get("detail") or response.reason_phrase)
        )
    if not isinstance(body, dict):
        raise TypeError(f"{response.url} answered with a JSON {type(body).__name__}, expected an object")
    return body

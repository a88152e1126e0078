"""Which requests are refused for whom they are for, and for which page sent them. Pure.

A page of another site can make a browser inside the hospital send requests here, and with DNS rebinding it can even
read the answers: its own name then leads to this machine. A program that is not a browser sends neither `Origin` nor
`Sec-Fetch-Site`, and calls this machine by an address or by a name that was set.
"""

import ipaddress
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Final
from urllib.parse import urlsplit

_ONLY_READING: Final = frozenset({"GET", "HEAD", "OPTIONS"})
# What a browser says of a request that the page itself, or the person in the address bar, has made.
_OWN_SITE: Final = frozenset({"same-origin", "none"})
_OWN_NAME: Final = "localhost"
# On every answer.
_SAFE: Final[Mapping[str, str]] = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "content-security-policy": "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    # Answers are of patients, or soon out of date.
    "cache-control": "no-store",
}
_EXPOSED: Final = "ETag, Case-ETag, Location, Retry-After, Allow"
_TAKEN: Final = "Authorization, Content-Type, Idempotency-Key, If-Match, If-None-Match, Last-Event-ID"
_HSTS: Final = "max-age=31536000"
# Chosen: names under which consoles call this machine, again and again.
_HOSTS_KEPT: Final = 64


class RequestRefusal(StrEnum):
    """Stable codes of requests that are refused before anything looks at what they want."""

    HOST_NOT_ALLOWED = "host_not_allowed"
    CROSS_SITE_REQUEST = "cross_site_request"
    AMBIGUOUS_LENGTH = "ambiguous_length"


@dataclass(frozen=True, slots=True)
class RefusedRequest:
    """A refusal and its sentence."""

    code: RequestRefusal
    message: str


@dataclass(frozen=True, slots=True)
class RequestFacts:
    """What of a request decides who sent it.

    Attributes
    ----------
    method
        HTTP method; a WebSocket that is opened counts as one that changes something, because it reads across sites.
    origin, fetch_site
        The headers `Origin` and `Sec-Fetch-Site`; None where there is none.
    framings
        How often the length of the body is stated: `Content-Length` and `Transfer-Encoding` headers together.
    """

    method: str
    scheme: str
    host: str
    origin: str | None = None
    fetch_site: str | None = None
    framings: int = 0


def refused_request(
    request: RequestFacts, allowed_hosts: Sequence[str], cors_origins: Sequence[str] = ()
) -> RefusedRequest | None:
    """Why a request is refused; None when it is not.

    Parameters
    ----------
    allowed_hosts
        Names under which this machine may be called, besides addresses and `localhost`.
    cors_origins
        Other origins whose pages may call this machine.
    """
    if request.framings > 1:
        return RefusedRequest(
            RequestRefusal.AMBIGUOUS_LENGTH,
            f"the request states the length of its body {request.framings} times; state it once, with Content-Length "
            "or with Transfer-Encoding",
        )
    if not is_allowed_host(request.host, allowed_hosts):
        return RefusedRequest(
            RequestRefusal.HOST_NOT_ALLOWED,
            f"the request is for the host {request.host[:80]!r}; call this machine by its address, or add the name to "
            "the setting allowed_hosts (DISTALOCK_UI_API_ALLOWED_HOSTS)",
        )
    if request.method in _ONLY_READING or request.origin in cors_origins:
        return None
    return _cross_site(request)


def cors_headers(origin: str | None, cors_origins: Sequence[str]) -> dict[str, str]:
    """What lets a page of another origin read an answer; empty for pages whose origin was not set.

    Cookies are not let through: such a page sends an access token.
    """
    if origin is None or origin not in cors_origins:
        return {}
    return {"access-control-allow-origin": origin, "access-control-expose-headers": _EXPOSED, "vary": "Origin"}


def preflight_headers(origin: str | None, cors_origins: Sequence[str]) -> dict[str, str]:
    """The answer to a browser that asks first; empty for origins that were not set."""
    allowed = cors_headers(origin, cors_origins)
    return allowed and {
        **allowed,
        "access-control-allow-methods": "GET, POST, PUT, PATCH, DELETE",
        "access-control-allow-headers": _TAKEN,
        "access-control-max-age": "600",
    }


def safe_headers(scheme: str) -> dict[str, str]:
    """What every answer forbids the browser; `scheme` is that by which it goes out."""
    return {**_SAFE, **({"strict-transport-security": _HSTS} if scheme == "https" else {})}


def is_allowed_host(host: str, allowed_hosts: Sequence[str]) -> bool:
    """Whether a `Host` header names this machine: by an address, which no foreign name is, or by an allowed name."""
    name = _host_name(host)
    if name is None:
        return False
    return _is_address(name) or name == _OWN_NAME or name in {allowed.lower() for allowed in allowed_hosts}


def _cross_site(request: RequestFacts) -> RefusedRequest | None:
    other_page = request.fetch_site is not None and request.fetch_site not in _OWN_SITE
    other_origin = request.origin is not None and not _is_same_origin(request)
    if not (other_page or other_origin):
        return None
    return RefusedRequest(
        RequestRefusal.CROSS_SITE_REQUEST,
        f"a page of {request.origin or 'another site'} sent the request (Sec-Fetch-Site: {request.fetch_site}); only "
        f"pages of {request.scheme}://{request.host} may change anything",
    )


def _is_same_origin(request: RequestFacts) -> bool:
    return (request.origin or "").lower() == f"{request.scheme}://{request.host}".lower()


@lru_cache(_HOSTS_KEPT)
def _host_name(host: str) -> str | None:
    """The name in a `Host` header, without port and brackets; None when it is none."""
    try:
        parts = urlsplit(f"//{host}")
        port = parts.port
    except ValueError:
        return None
    plain = parts.netloc == host and not parts.path and "@" not in host and port != 0
    return parts.hostname if plain else None


@lru_cache(_HOSTS_KEPT)
def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True

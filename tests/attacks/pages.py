"""Attacks by pages in a browser: under a foreign name, from a foreign page, without an origin."""

from typing import Final

from tests.attacks.attack import Attack
from tests.attacks.web import PORT, gateway_log, request_to

_EVIL: Final = "evil.example"
_PAGE: Final = "a page in a browser of the hospital"
_MOTION: Final = b'{"plan": 1}'

ATTACKS: Final = (
    Attack(
        "DNS rebinding",
        _PAGE,
        "make its own name lead here, and start the approved motion",
        "host_not_allowed",
        gateway_log("host_not_allowed"),
        request_to("POST", "/cases/{case}/motions", {"Host": f"{_EVIL}:8000"}, _MOTION),
    ),
    Attack(
        "host header",
        PORT,
        "read cases under a name that only looks like this machine",
        "host_not_allowed",
        gateway_log("host_not_allowed"),
        request_to("GET", "/cases", {"Host": f"127.0.0.1.{_EVIL}"}),
    ),
    Attack(
        "cross-site request",
        _PAGE,
        "start the approved motion from a form",
        "cross_site_request",
        gateway_log("cross_site_request"),
        request_to(
            "POST", "/cases/{case}/motions", {"Origin": f"https://{_EVIL}", "Sec-Fetch-Site": "cross-site"}, _MOTION
        ),
    ),
    Attack(
        "sandboxed page",
        _PAGE,
        "the same from a frame without an origin",
        "cross_site_request",
        gateway_log("cross_site_request"),
        request_to("POST", "/cases/{case}/motions", {"Origin": "null"}, _MOTION),
    ),
    Attack(
        "another port's page",
        "a page that another program on this machine serves",
        "start the approved motion",
        "cross_site_request",
        gateway_log("cross_site_request"),
        request_to(
            "POST", "/cases/{case}/motions", {"Origin": "http://127.0.0.1:1", "Sec-Fetch-Site": "same-site"}, _MOTION
        ),
    ),
    Attack(
        "cross-site viewer",
        _PAGE,
        "open `WS /live`",
        "403",
        gateway_log("cross_site_request"),
        request_to(
            "GET",
            "/live",
            {
                "Origin": f"https://{_EVIL}",
                "Connection": "Upgrade",
                "Upgrade": "websocket",
                "Sec-WebSocket-Version": "13",
                "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
            },
            b"",
        ),
    ),
)

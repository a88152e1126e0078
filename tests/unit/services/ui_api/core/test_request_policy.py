"""Whom a request is for, and which page sent it."""

import pytest

from services.ui_api.core.request_policy import RequestFacts, RequestRefusal, is_allowed_host, refused_request

HERE = "127.0.0.1:8000"


@pytest.mark.parametrize(
    "host", [HERE, "localhost:8000", "LOCALHOST", "[::1]:8000", "192.168.7.3", "or1.hospital:8000"]
)
def test_addresses_and_allowed_names_are_this_machine(host: str) -> None:
    assert is_allowed_host(host, ["OR1.hospital"])


@pytest.mark.parametrize(
    "host",
    ["", "evil.example", "127.0.0.1.evil.example", "localhost.evil.example", "user@127.0.0.1", "127.0.0.1/x", "a b",
     "127.0.0.1:port", "127.0.0.1:0", "or1.hospital.evil", "[::1", "0x7f.1", "evil.example:8000#127.0.0.1"],
)  # fmt: skip
def test_other_names_are_not(host: str) -> None:
    assert not is_allowed_host(host, ["or1.hospital"])


def code(**facts: object) -> RequestRefusal | None:
    request = RequestFacts(**({"method": "POST", "scheme": "http", "host": HERE} | facts))  # type: ignore[arg-type]  # facts by name
    refused = refused_request(request, ())
    return None if refused is None else refused.code


def test_programs_that_are_no_browsers_may_do_everything() -> None:
    assert code() is None


def test_the_own_page_may_do_everything() -> None:
    assert code(origin=f"http://{HERE}", fetch_site="same-origin") is None


@pytest.mark.parametrize("method", ["POST", "PUT", "PATCH", "DELETE", "WEBSOCKET"])
@pytest.mark.parametrize(
    "sender",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:9000"},
        {"origin": f"https://{HERE}"},
        {"fetch_site": "cross-site"},
        {"fetch_site": "same-site"},
    ],
)
def test_other_pages_change_nothing(method: str, sender: dict[str, str]) -> None:
    assert code(method=method, **sender) is RequestRefusal.CROSS_SITE_REQUEST


def test_a_link_on_another_page_may_lead_here() -> None:
    assert code(method="GET", fetch_site="cross-site") is None


def test_a_length_that_is_stated_twice_is_refused() -> None:
    assert code(framings=2) is RequestRefusal.AMBIGUOUS_LENGTH
    assert code(framings=1) is None

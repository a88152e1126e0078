"""What an identity provider must not get away with: every check of the way back, against a provider that is played."""

import base64
import hashlib
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest
from joserfc import jwt
from joserfc.jwk import RSAKey

from services.ui_api.access.provider import Provider
from services.ui_api.access.provider_claims import identity_of_claims
from services.ui_api.core.access_settings import ProviderSettings
from services.ui_api.core.roles import Role
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.refusals import Refused

ISSUER = "https://login.hospital.example"
BACK = "http://localhost:8000/api/v1/sessions/provider/return"
SETTINGS = ProviderSettings(
    issuer=ISSUER,
    client_id="or1",
    client_secret="between us",
    scope="openid profile",
    name_claim="preferred_username",
    roles_claim="groups",
    roles={"or-surgeons": Role.SURGEON, "or-staff": Role.TECHNICIAN},
)
KEY = RSAKey.generate_key(2048, {"kid": "1", "use": "sig"}, private=True)
CLOCK = Clock()
Claims = dict[str, Any]


class PlayedProvider:
    """Answers as a provider does; `alter` changes the ID token's claims, `key` signs them."""

    def __init__(self) -> None:
        self.alter: Callable[[Claims], Claims] = lambda claims: claims
        self.key, self.algorithm = KEY, "RS256"
        self.form: dict[str, str] = {}
        self.nonce, self.authorisation = "", ""
        self.issuer = ISSUER

    def answer(self, request: httpx.Request) -> httpx.Response:
        """One request."""
        match request.url.path:
            case "/.well-known/openid-configuration":
                places = {"authorization_endpoint": "/authorise", "token_endpoint": "/token", "jwks_uri": "/keys"}
                document = {name: f"{ISSUER}{place}" for name, place in places.items()}
                return httpx.Response(200, json={"issuer": self.issuer, **document})
            case "/keys":
                return httpx.Response(200, json={"keys": [KEY.as_dict(private=False)]})
        self.form = {name: values[0] for name, values in parse_qs(request.content.decode()).items()}
        self.authorisation = request.headers.get("authorization", "")
        if self.form["code"] != "good":
            return httpx.Response(400, json={"error": "invalid_grant"})
        now = int(time.time())
        claims = {
            "iss": ISSUER,
            "sub": "4711",
            "aud": "or1",
            "iat": now,
            "exp": now + 300,
            "nonce": self.nonce,
            "preferred_username": "Dr.A@hospital.example",
            "groups": ["everybody", "or-surgeons"],
        }
        header = {"alg": self.algorithm, "kid": "1"}
        return httpx.Response(200, json={"id_token": jwt.encode(header, self.alter(claims), self.key)})


class Trip:
    """A browser that was sent away."""

    def __init__(self, played: PlayedProvider, clock: Clock = CLOCK) -> None:
        self.provider = Provider(SETTINGS, clock, httpx.MockTransport(played.answer))
        self.departure = self.provider.depart(BACK)
        self.asked = {name: values[0] for name, values in parse_qs(urlsplit(self.departure.url).query).items()}
        played.nonce = self.asked["nonce"]

    def back(self, **changed: str) -> Any:
        """Comes back, with something changed on the way."""
        brought = {"state": self.asked["state"], "code": "good", "browser_secret": self.departure.browser_secret}
        return self.provider.arrive(**(brought | changed), redirect_uri=BACK)


def refused(what: Callable[[], object]) -> str:
    with pytest.raises(Refused) as caught:
        what()
    return caught.value.code


def test_who_comes_back_is_known_by_subject_name_and_roles() -> None:
    played = PlayedProvider()
    trip = Trip(played)
    found = trip.back()
    assert (found.subject, found.name, found.roles) == (f"{ISSUER} 4711", "dr.a", frozenset({Role.SURGEON}))
    verifier = hashlib.sha256(played.form["code_verifier"].encode()).digest()
    assert trip.asked["code_challenge"] == base64.urlsafe_b64encode(verifier).rstrip(b"=").decode()
    assert trip.asked["code_challenge_method"] == "S256"
    assert base64.b64decode(played.authorisation.removeprefix("Basic ")) == b"or1:between us"
    assert refused(trip.back) == "sign_in_unknown", "a way back is gone once"


def test_another_browser_or_a_wrong_code_lets_nobody_in() -> None:
    assert refused(lambda: Trip(PlayedProvider()).back(browser_secret="guessed")) == "sign_in_of_another_browser"
    assert refused(lambda: Trip(PlayedProvider()).back(state="guessed")) == "sign_in_unknown"
    assert refused(lambda: Trip(PlayedProvider()).back(code="bad")) == "provider_refused"


@pytest.mark.parametrize(
    "changed",
    [
        {"iss": "https://login.evil.example"},
        {"aud": "another client"},
        {"aud": ["or1", "another"], "azp": "another"},
        {"nonce": "of another sign-in"},
        {"exp": int(time.time()) - 3600},
        {"iat": int(time.time()) + 3600},
        {"sub": None},
    ],
    ids=["issuer", "audience", "authorised party", "nonce", "expired", "of the future", "no subject"],
)
def test_a_token_that_is_not_for_this_sign_in_is_refused(changed: Claims) -> None:
    played = PlayedProvider()
    played.alter = lambda claims: {name: v for name, v in (claims | changed).items() if v is not None}
    assert refused(Trip(played).back) == "id_token_invalid"


def test_a_token_that_the_provider_did_not_sign_is_refused() -> None:
    played = PlayedProvider()
    played.key = RSAKey.generate_key(2048, {"kid": "1"}, private=True)
    assert refused(Trip(played).back) == "id_token_invalid"


def test_a_provider_that_calls_itself_otherwise_is_not_asked() -> None:
    played = PlayedProvider()
    played.issuer = "https://login.evil.example"
    assert refused(lambda: Trip(played)) == "provider_unavailable"


def test_a_way_back_of_yesterday_is_refused() -> None:
    now_s = [0.0]
    trip = Trip(PlayedProvider(), Clock(monotonic_s=lambda: now_s[0]))
    now_s[0] = 601.0
    assert refused(trip.back) == "sign_in_unknown"


@pytest.mark.parametrize(("name", "stated"), [({}, "'None'"), ({"preferred_username": "7"}, "'7'")])
def test_who_has_no_name_for_an_account_is_known_with_the_reason(name: Claims, stated: str) -> None:
    identity = identity_of_claims({"sub": "1", "groups": ["or-staff"], **name}, SETTINGS)
    assert (identity.subject, identity.roles) == (f"{ISSUER} 1", frozenset({Role.TECHNICIAN}))
    assert f"the claim 'preferred_username' is {stated}, and an account needs" in (identity.name_refusal or "")
    usable = identity_of_claims({"sub": "1", "preferred_username": "dr.a"}, SETTINGS)
    assert usable.name_refusal is None


@pytest.mark.parametrize(
    ("claims", "sentence"),
    [
        (
            {"preferred_username": "dr.a", "groups": ["everybody"]},
            "'dr.a' has no role here: the claim 'groups' has e",
        ),
        ({"preferred_username": "dr.a"}, "the claim 'groups' has nothing, and roles come from or-surgeons, or-staff"),
        ({}, f"'{ISSUER} 1' has no role here"),
    ],
)
def test_who_has_no_role_is_known_and_refused(claims: Claims, sentence: str) -> None:
    identity = identity_of_claims({"sub": "1", **claims}, SETTINGS)
    assert (identity.subject, identity.roles) == (f"{ISSUER} 1", frozenset())
    refusal = Trip(PlayedProvider()).provider.roles_missing(identity)
    assert (refusal.code, sentence in str(refusal)) == ("provider_roles_missing", True), str(refusal)

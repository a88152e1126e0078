"""Signing in with the hospital's identity provider: OpenID Connect, authorisation code with PKCE.

The browser is sent to the provider with a state, a nonce and the hash of a secret, and comes back with a code. The
gateway exchanges the code and the secret for an ID token, whose signature and claims it checks. What it takes from it
is who it is, and by a claim which roles; the provider's own tokens are thrown away.
"""

import hashlib
import hmac
import secrets
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlencode

import httpx
from authlib.oauth2.rfc7636 import create_s256_code_challenge
from authlib.oidc.core import CodeIDToken
from joserfc import jws, jwt
from joserfc.errors import JoseError
from joserfc.jwk import KeySet

from services.ui_api.access.provider_claims import identity_of_claims, roles_missing
from services.ui_api.core.access_settings import ProviderSettings
from services.ui_api.core.identity import ProviderIdentity
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.refusals import RefusalKind, Refused, unauthenticated

# Chosen: time for a second factor; a bound on memory; what two clocks in a hospital may differ by.
ROUND_TRIP_S: Final = 600.0
_TIMEOUT_S: Final = 5.0
_MOST_PENDING: Final = 256
_LEEWAY_S: Final = 60
# Signatures with a key of the provider's; none with the client's secret, and never `none`.
_ALGORITHMS: Final = ("RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA")
_DISCOVERY: Final = "/.well-known/openid-configuration"
_NANOSECONDS: Final = 10**9


@dataclass(frozen=True, slots=True)
class Departure:
    """A browser on its way to the provider: where it goes, and what it must bring back in its cookie."""

    url: str
    browser_secret: str


@dataclass(frozen=True, slots=True)
class _Pending:
    nonce: str
    code_verifier: str
    browser_sha256: str
    ends_s: float


class Provider:
    """One identity provider. Its addresses and keys are fetched when they are needed, and kept."""

    def __init__(self, settings: ProviderSettings, clock: Clock, transport: httpx.BaseTransport | None = None) -> None:
        self._settings, self._clock = settings, clock
        self._transport = transport
        self._lock = threading.Lock()
        self._pending: dict[str, _Pending] = {}
        self._metadata: Mapping[str, Any] | None = None
        self._keys: KeySet | None = None

    @property
    def issuer(self) -> str:
        """The provider's name."""
        return self._settings.issuer

    def depart(self, redirect_uri: str) -> Departure:
        """Where to send the browser; raises `Refused`."""
        endpoint = str(self._known_metadata()["authorization_endpoint"])
        state, nonce, verifier, browser = (secrets.token_urlsafe(32) for _ in range(4))
        now_s = self._clock.monotonic_s()
        with self._lock:
            good = {name: one for name, one in self._pending.items() if one.ends_s > now_s}
            newest = dict(list(good.items())[-_MOST_PENDING + 1 :])
            self._pending = {**newest, state: _Pending(nonce, verifier, _sha256(browser), now_s + ROUND_TRIP_S)}
        query = {
            "response_type": "code",
            "client_id": self._settings.client_id,
            "redirect_uri": redirect_uri,
            "scope": self._settings.scope,
            "state": state,
            "nonce": nonce,
            "code_challenge": create_s256_code_challenge(verifier),
            "code_challenge_method": "S256",
        }
        return Departure(f"{endpoint}{'&' if '?' in endpoint else '?'}{urlencode(query)}", browser)

    def arrive(self, state: str, code: str, browser_secret: str, redirect_uri: str) -> ProviderIdentity:
        """Who has come back, perhaps without a role (`roles_missing`); raises `Refused`."""
        with self._lock:
            pending = self._pending.pop(state, None)
        if pending is None or pending.ends_s <= self._clock.monotonic_s():
            raise unauthenticated(
                "sign_in_unknown", f"this sign-in was not begun here within {ROUND_TRIP_S:g} s; begin again"
            )
        if not hmac.compare_digest(_sha256(browser_secret), pending.browser_sha256):
            raise unauthenticated("sign_in_of_another_browser", "this sign-in began in another browser; begin again")
        tokens = self._exchanged(code, pending.code_verifier, redirect_uri)
        return identity_of_claims(self._claims(tokens, pending.nonce), self._settings)

    def roles_missing(self, identity: ProviderIdentity) -> Refused:
        """Refusal of somebody who has come back without a role."""
        return roles_missing(identity, self._settings)

    def _exchanged(self, code: str, code_verifier: str, redirect_uri: str) -> Mapping[str, Any]:
        """The tokens for a code. The client's secret goes in the head (`client_secret_basic`)."""
        form = {
            "grant_type": "authorization_code",
            "code": code,
            "redirect_uri": redirect_uri,
            "code_verifier": code_verifier,
        }
        settings = self._settings
        auth = httpx.Auth()
        if settings.client_secret is None:
            form["client_id"] = settings.client_id
        else:
            auth = httpx.BasicAuth(settings.client_id, settings.client_secret)
        endpoint = str(self._known_metadata()["token_endpoint"])
        try:
            with self._client() as client:
                answer = client.post(endpoint, data=form, auth=auth)
            tokens: Mapping[str, Any] = answer.json()
        except (httpx.HTTPError, ValueError) as error:
            raise self._out_of_reach(error) from error
        if answer.status_code != httpx.codes.OK or "id_token" not in tokens:
            named = str(tokens.get("error", f"status {answer.status_code}"))[:80]
            raise unauthenticated("provider_refused", f"the identity provider gave no token ({named}); sign in again")
        return tokens

    def _claims(self, tokens: Mapping[str, Any], nonce: str) -> Mapping[str, Any]:
        """Claims of the ID token, once its signature and they themselves are checked; raises `Refused`."""
        try:
            token = self._verified(str(tokens["id_token"]))
            claims = CodeIDToken(
                token.claims,
                token.header,
                {"iss": {"value": self.issuer}, "aud": {"value": self._settings.client_id}},
                {"nonce": nonce, "client_id": self._settings.client_id, "access_token": tokens.get("access_token")},
            )
            claims.validate(now=self._clock.unix_ns() // _NANOSECONDS, leeway=_LEEWAY_S)
        except (JoseError, ValueError) as error:
            raise unauthenticated(
                "id_token_invalid",
                f"the identity provider's token is not valid ({str(error)[:120]}); compare the clocks and the "
                "settings of both",
            ) from error
        return dict(claims)

    def _verified(self, id_token: str) -> jwt.Token:
        """The token under the provider's keys, which are fetched anew when one is not known."""
        registry = jws.JWSRegistry(algorithms=list(_ALGORITHMS))
        try:
            return jwt.decode(id_token, self._known_keys(), registry=registry)
        except (JoseError, ValueError):
            self._keys = None
            return jwt.decode(id_token, self._known_keys(), registry=registry)

    def _known_metadata(self) -> Mapping[str, Any]:
        if self._metadata is None:
            found = self._fetched(self.issuer.rstrip("/") + _DISCOVERY)
            if found.get("issuer") != self.issuer or not {"authorization_endpoint", "token_endpoint"} <= found.keys():
                raise self._out_of_reach(ValueError(f"it calls itself {str(found.get('issuer'))[:120]!r}"))
            self._metadata = found
        return self._metadata

    def _known_keys(self) -> KeySet:
        if self._keys is None:
            try:
                self._keys = KeySet.import_key_set(self._fetched(str(self._known_metadata()["jwks_uri"])))  # type: ignore[arg-type]
            except (JoseError, KeyError) as error:
                raise self._out_of_reach(error) from error
        return self._keys

    def _client(self) -> httpx.Client:
        """A client for one request: people sign in rarely, and connections that idle are closed by the other side."""
        return httpx.Client(timeout=_TIMEOUT_S, transport=self._transport, follow_redirects=False)

    def _fetched(self, url: str) -> Mapping[str, Any]:
        try:
            with self._client() as client:
                answer = client.get(url)
            answer.raise_for_status()
            found = answer.json()
        except (httpx.HTTPError, ValueError) as error:
            raise self._out_of_reach(error) from error
        if not isinstance(found, dict):
            raise self._out_of_reach(ValueError("its answer is not an object"))
        return found

    def _out_of_reach(self, error: Exception) -> Refused:
        return Refused(
            RefusalKind.UNAVAILABLE,
            "provider_unavailable",
            f"the identity provider {self.issuer} does not answer as it should ({str(error)[:120]}); sign in with a "
            "password, or try again",
            _TIMEOUT_S,
        )


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()

"""Attacks by people and programs: without a login, with one of another role, with a copied token, by guessing."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import httpx

from distalock.rest_client import bearer
from services.ui_api.core.lockout import FREE_FAILURES
from tests.attacks.attack import Attack, Record
from tests.attacks.site import Site
from tests.attacks.web import code_of, gateway_log, request_to

_NETWORK: Final = "the hospital's network"
_PASSWORD: Final = "four words and a nail"
_MOTION: Final = b'{"plan": 1}'
_HOPELESS: Final = "of-somebody-who-guesses"


def _session_of(site: Site, role: str) -> Mapping[str, object]:
    """The session of an account with this role, which an administrator has made."""
    account = {"name": f"a.{role}", "password": _PASSWORD}
    if all(one["name"] != account["name"] for one in _users(site)):
        site.rest.post("/api/v1/users", {**account, "roles": [role]})
    return site.rest.post("/api/v1/sessions", account)


def _users(site: Site) -> list[dict[str, object]]:
    items = site.rest.get("/api/v1/users?limit=200")["items"]
    assert isinstance(items, list)
    return items


def _as(role: str, method: str, path: str, content: bytes = b"{}") -> Callable[[Site], str]:
    """A request in the session of somebody with this role; as plan and case, `{plan}` and `{case}` of the site."""

    def run(site: Site) -> str:
        headers = bearer(str(_session_of(site, role)["access_token"]))
        return request_to(method, path, {**headers, "If-Match": f'"{site.plan.sha256}"'}, content)(site)

    return run


def _without_a_login(site: Site, headers: Mapping[str, str]) -> str:
    where = f"{site.api}/cases/{site.case.id}/motions"
    return code_of(httpx.post(where, content=_MOTION, headers={"Idempotency-Key": "nobody", **headers}))


def _after_signing_out(site: Site) -> str:
    headers = bearer(str(_session_of(site, "surgeon")["access_token"]))
    httpx.delete(f"{site.api}/sessions/current", headers=headers).raise_for_status()
    return _without_a_login(site, headers)


def _copied_refresh_token(site: Site) -> str:
    """The thief uses it first, the user second; then neither has anything."""
    session = _session_of(site, "surgeon")
    copy = {"refresh_token": session["refresh_token"]}
    stolen = httpx.post(f"{site.api}/sessions/refresh", json=copy).json()
    noticed = code_of(httpx.post(f"{site.api}/sessions/refresh", json=copy))
    left = code_of(httpx.get(f"{site.api}/robot", headers=bearer(stolen["access_token"])))
    return noticed if left == "token_invalid" else f"the thief goes on: {left}"


def _guessing(site: Site) -> str:
    """Guesses until they are no longer compared; the right password does not help then, and others sign in."""
    _session_of(site, "viewer")
    for _ in range(FREE_FAILURES):
        httpx.post(f"{site.api}/sessions", json={"name": "a.viewer", "password": _HOPELESS})
    code = code_of(httpx.post(f"{site.api}/sessions", json={"name": "a.viewer", "password": _PASSWORD}))
    return code if _session_of(site, "technician")["user"] == "a.technician" else "everybody is locked out"


def _foreign_answer(site: Site) -> str:
    """Somebody's key, sent by somebody else: the stored answer is not his."""
    path, key = (
        f"{site.api}/cases/{site.case.id}/steps",
        {"Idempotency-Key": "seen on somebody's screen", "If-Match": site.case.etag()},
    )
    step = {"step": "finished", "hole_ids": ["none"]}
    first = httpx.post(path, json=step, headers={**key, **bearer(site.installation.token)})
    assert first.is_client_error, first.text
    other = bearer(str(_session_of(site, "technician")["access_token"]))
    return code_of(httpx.post(path, json=step, headers={**key, **other}))


ATTACKS: Final = (
    Attack(
        "no token",
        _NETWORK,
        "start the approved motion without a login",
        "token_missing",
        gateway_log("token_missing"),
        partial(_without_a_login, headers={}),
    ),
    Attack(
        "made-up token",
        _NETWORK,
        "start it with a token of their own making",
        "token_invalid",
        gateway_log("token_invalid"),
        partial(_without_a_login, headers=bearer(_HOPELESS)),
    ),
    Attack(
        "token after signing out",
        "an access token of a session that has ended",
        "start the approved motion",
        "token_invalid",
        gateway_log("token_invalid"),
        _after_signing_out,
    ),
    *(
        Attack(
            f"motion as {role}",
            f"a session as {role}",
            "start the approved motion",
            "not_permitted",
            gateway_log("not_permitted"),
            _as(role, "POST", "/cases/{case}/motions", _MOTION),
        )
        for role in ("viewer", "technician", "administrator")
    ),
    Attack(
        "approval as technician",
        "a session as technician",
        "approve the plan",
        "not_permitted",
        gateway_log("not_permitted"),
        _as("technician", "POST", "/cases/{case}/plans/{plan}/approval"),
    ),
    Attack(
        "account as surgeon",
        "a session as surgeon",
        "make an account for an accomplice",
        "not_permitted",
        gateway_log("not_permitted"),
        _as("surgeon", "POST", "/users"),
    ),
    Attack(
        "approval at an unattended console",
        "a surgeon's session, not the password",
        "approve a plan",
        "credential_missing",
        gateway_log("credential_missing"),
        _as("surgeon", "POST", "/cases/{case}/plans/{plan}/approval"),
    ),
    Attack(
        "approval with a guessed password",
        "a surgeon's session, not the password",
        "approve a plan",
        "credential_wrong",
        gateway_log("login_failed"),
        _as("surgeon", "POST", "/cases/{case}/plans/{plan}/approval", f'{{"password": "{_HOPELESS}"}}'.encode()),
    ),
    Attack(
        "copied refresh token",
        "a copy of a refresh token",
        "renew the session, before its user does",
        "refresh_token_reused",
        Record("case-record", "refresh_token_reused"),
        _copied_refresh_token,
    ),
    Attack(
        "password guessing",
        _NETWORK,
        f"{FREE_FAILURES} wrong passwords, then the right one",
        "login_locked",
        gateway_log("login_failed"),
        _guessing,
    ),
    Attack(
        "set-up link",
        _NETWORK,
        "make themselves an administrator by a made-up link",
        "setup_link_invalid",
        gateway_log("setup_link_invalid"),
        lambda site: code_of(
            httpx.post(f"{site.api}/setup?token={_HOPELESS}", data={"name": "mallory", "password": _PASSWORD})
        ),
    ),
    Attack(
        "another user's answer",
        "a session as technician, somebody's idempotency key",
        "get the stored answer",
        "idempotency_key_reused",
        gateway_log("idempotency_key_reused"),
        _foreign_answer,
    ),
)

"""What Schemathesis calls around each request: who asks, for what that there is, and whether he may.

Runs inside Schemathesis, with what `tests.fuzz.runner` puts into the environment.
"""

import atexit
import http
import itertools
import json
import os
import random
import threading
import time
import urllib.error
import urllib.request
from collections import Counter
from pathlib import Path
from typing import Any, Final

import schemathesis
from schemathesis import cli
from schemathesis.engine import events
from schemathesis.engine.run import PhaseName

_CONTEXT: Final = json.loads(os.environ["DISTALOCK_FUZZ"])
_ACTION: Final = "x-distalock-action"
_MATCH: Final = "If-Match"
# Half of the requests are for what there is, and quote what was read: the others are refused before they are looked at.
_SHARE_OF_REAL: Final = 0.5
# Of the bodies in sequences: a generated one is nearly always refused, and no link leads on from a refusal.
_SHARE_OF_GOOD_BODIES: Final = 0.7
_MOST_SIGN_INS: Final = 20
_TOKEN_PROBLEMS: Final = ("token_missing", "token_invalid", "token_expired")
# The one 5xx that says what the document says it does: that a part which a procedure needs is not as it should be, as a
# robot in fault. Its text has to name such a part.
_NOT_READY: Final = ("read_readiness", http.HTTPStatus.SERVICE_UNAVAILABLE, "not_ready")
_new_users: Final = itertools.count(1)
_random: Final = random.Random(_CONTEXT["seed"])


class Session:
    """Who asks; signs in anew when the session was ended, as a generated request may."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.token = ""

    def sign_in(self) -> None:
        """Open a session."""
        body = json.dumps({"name": _CONTEXT["name"], "password": _CONTEXT["password"]}).encode()
        request = urllib.request.Request(
            f"{_CONTEXT['url']}/api/v1/sessions", body, {"Content-Type": "application/json"}
        )
        for _ in range(_MOST_SIGN_INS):
            try:
                with self._lock, urllib.request.urlopen(request, timeout=60.0) as answer:
                    self.token = json.loads(answer.read())["access_token"]
                    return
            except urllib.error.HTTPError as error:
                if error.code == http.HTTPStatus.TOO_MANY_REQUESTS:  # generated passwords lock the account for a while
                    time.sleep(float(error.headers["Retry-After"]))
                else:
                    _mend_account()
        raise RuntimeError(f"{_CONTEXT['name']} cannot sign in any more")

    def case_etag(self, case_id: str) -> str:
        """The case as it is now; nothing for who may not read."""
        url = f"{_CONTEXT['url']}/api/v1/cases/{case_id}"
        request = urllib.request.Request(url, headers={"Authorization": f"Bearer {self.token}"})
        try:
            with urllib.request.urlopen(request, timeout=60.0) as answer:
                return str(answer.headers["ETag"])
        except OSError:
            return ""


def _mend_account() -> None:
    """A generated request has given the account another password or other roles, or has disabled it."""
    content = {"password": _CONTEXT["password"], "roles": _CONTEXT["roles"], "disabled": False}
    headers = {"Content-Type": "application/json", "Authorization": f"Bearer {_CONTEXT['administrator']}"}
    url = f"{_CONTEXT['url']}/api/v1/users/{_CONTEXT['name']}"
    request = urllib.request.Request(url, json.dumps(content).encode(), headers, method="PATCH")
    urllib.request.urlopen(request, timeout=60.0).close()


class Tally:
    """What came of the requests."""

    def __init__(self) -> None:
        self.answers = Counter[str]()
        self.phases = Counter[str]()
        self.not_ready = 0
        self.beyond: list[str] = []
        self.links = Counter[str]()
        self.links_that_succeeded = Counter[str]()
        self.inferred = 0
        self.sequences = 0
        self.longest = 0

    def write(self) -> None:
        """Write it to where the runner reads it."""
        content = {name: getattr(self, name) for name in vars(self)}
        Path(_CONTEXT["tally"]).write_text(json.dumps(content), encoding="utf-8")


_session: Final = Session()
_tally: Final = Tally()
_known: Final[dict[str, object]] = dict(_CONTEXT["known"])
# Identifiers in answers so far: what follows a link to one of them goes there.
_there_is: Final = {str(value) for value in _known.values()}
atexit.register(_tally.write)


@schemathesis.hook
def before_call(context: Any, case: Any, kwargs: Any) -> None:
    """Sign in, and ask for what there is."""
    if not _session.token:
        _session.sign_in()
    case.headers["Authorization"] = f"Bearer {_session.token}"
    in_sequence = _phase_of(case) == "stateful"
    if not in_sequence and _random.random() > _SHARE_OF_REAL:
        return
    placed = case.path_parameters or {}
    known = {name: value for name, value in _known_for(case.path).items() if name in placed}
    if in_sequence:
        known = {name: value for name, value in known.items() if str(placed[name]) not in _there_is}
    if known:
        case.path_parameters.update(known)
    if in_sequence and _random.random() < _SHARE_OF_GOOD_BODIES:
        _give_good_body(case)
    if _MATCH in case.headers and "case_id" in placed:
        case.headers[_MATCH] = _quoted(case, in_sequence=in_sequence)


def _give_good_body(case: Any) -> None:
    """One that is granted as long as the state of things allows it."""
    name = case.operation.definition.raw.get("operationId")
    body = _CONTEXT["bodies"].get(name)
    if body is not None:
        case.body = body | ({"name": f"u.{next(_new_users)}"} if name == "create_user" else {})


def _known_for(path: str) -> dict[str, object]:
    return _known | ({"name": _CONTEXT["known_user"]} if "/users/" in path else {})


def _quoted(case: Any, *, in_sequence: bool) -> str:
    """The newest ETag of what is changed; in a sequence that of a plan comes by its link."""
    given = str(case.headers[_MATCH])
    if case.path.endswith("/approval"):
        return given if in_sequence and given.startswith('"') else str(_CONTEXT["plan_etag"])
    return _session.case_etag(str(case.path_parameters["case_id"])) or given


def _phase_of(case: Any) -> str:
    return "" if case.meta is None else str(case.meta.phase.name.value)


@schemathesis.hook
def after_call(context: Any, case: Any, response: Any) -> None:
    """Count; and sign in again where the session has ended."""
    _tally.answers[str(response.status_code)] += 1
    _tally.phases[_phase_of(case)] += 1
    if response.status_code == http.HTTPStatus.UNAUTHORIZED and any(code in response.text for code in _TOKEN_PROBLEMS):
        _session.sign_in()
    if response.status_code < http.HTTPStatus.MULTIPLE_CHOICES:
        _note_identifiers(case, response)


def _note_identifiers(case: Any, response: Any) -> None:
    try:
        content = response.json()
    except ValueError:
        return
    listed = content.get("items", [content]) if isinstance(content, dict) else content
    for one in listed if isinstance(listed, list) else ():
        if isinstance(one, dict):
            _there_is.update(str(one[name]) for name in ("id", "name", "number") if one.get(name) is not None)
    if case.operation.definition.raw.get("operationId") == "open_case":
        _known["case_id"] = content["id"]


@schemathesis.check
def no_server_error(ctx: Any, response: Any, case: Any) -> None:
    """Nothing is answered with 5xx, but by `/readyz` while a part is not ready, which it has to name."""
    if response.status_code < http.HTTPStatus.INTERNAL_SERVER_ERROR:
        return
    name = case.operation.definition.raw.get("operationId")
    if (name, response.status_code) == _NOT_READY[:2]:
        problem = response.json()
        if problem["code"] == _NOT_READY[2] and any(not check["ok"] for check in problem["checks"]):
            _tally.not_ready += 1
            return
    raise AssertionError(f"{case.method} {case.path} was answered with {response.status_code}: {response.text[:300]}")


@schemathesis.check
def within_role(ctx: Any, response: Any, case: Any) -> None:
    """Nobody gets what his role may not do: 401 or 403 is the answer, whatever else is wrong."""
    action = case.operation.definition.raw.get(_ACTION)
    if response.status_code < http.HTTPStatus.BAD_REQUEST and action not in _CONTEXT["actions"]:
        answered = f"{case.method} {case.path} was answered with {response.status_code}"
        sentence = f"{answered}, and '{action}' is not for {_CONTEXT['name']}"
        _tally.beyond.append(sentence)
        raise AssertionError(sentence)


class Links:
    """Counts the links that sequences followed; as one of Schemathesis's handlers of events."""

    def __init__(self, *args: Any, **parameters: Any) -> None:
        """Needs nothing."""

    def start(self, ctx: Any) -> None:
        """Nothing is to be begun."""

    def shutdown(self, ctx: Any) -> None:
        """Nothing is to be ended."""

    def handle_event(self, ctx: Any, event: Any) -> None:  # noqa: ARG002 - Schemathesis's interface
        """Take in a sequence."""
        if not isinstance(event, events.ScenarioFinished) or event.phase != PhaseName.STATEFUL_TESTING:
            return
        lengths: dict[str, int] = {}
        for case_id, node in event.recorder.cases.items():
            if node.transition is None or not node.is_transition_applied:
                continue
            lengths[case_id] = lengths.get(node.transition.parent_id, 0) + 1
            if node.transition.is_inferred:
                _tally.inferred += 1
                continue
            _tally.links[node.transition.id] += 1
            answered = event.recorder.interactions.get(case_id)
            response = None if answered is None else answered.response
            if response is not None and response.status_code < http.HTTPStatus.BAD_REQUEST:
                _tally.links_that_succeeded[node.transition.id] += 1
        _tally.sequences += bool(lengths)
        _tally.longest = max([_tally.longest, *lengths.values()])


cli.handler()(Links)

"""What Schemathesis calls around each request: who asks, for what that there is, and whether he may.

Runs inside Schemathesis, with what `tests.fuzz.runner` puts into the environment.
"""

import atexit
import http
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

_CONTEXT: Final = json.loads(os.environ["DISTALOCK_FUZZ"])
_ACTION: Final = "x-distalock-action"
_MATCH: Final = "If-Match"
# Half of the requests are for what there is, and quote what was read: the others are refused before they are looked at.
_SHARE_OF_REAL: Final = 0.5
_MOST_SIGN_INS: Final = 20
_TOKEN_PROBLEMS: Final = ("token_missing", "token_invalid", "token_expired")
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
                if error.code != http.HTTPStatus.TOO_MANY_REQUESTS:  # generated passwords lock the account for a while
                    raise
                time.sleep(float(error.headers["Retry-After"]))

    def case_etag(self, case_id: str) -> str:
        """The case as it is now; nothing for who may not read."""
        url = f"{_CONTEXT['url']}/api/v1/cases/{case_id}"
        request = urllib.request.Request(url, headers={"Authorization": f"Bearer {self.token}"})
        try:
            with urllib.request.urlopen(request, timeout=60.0) as answer:
                return str(answer.headers["ETag"])
        except OSError:
            return ""


_session: Final = Session()
_answers: Final = Counter[str]()
_beyond: Final[list[str]] = []


@schemathesis.hook
def before_call(context: Any, case: Any, kwargs: Any) -> None:
    """Sign in, and ask for what there is."""
    if not _session.token:
        _session.sign_in()
    case.headers["Authorization"] = f"Bearer {_session.token}"
    if _random.random() > _SHARE_OF_REAL:
        return
    known = {name: value for name, value in _CONTEXT["known"].items() if name in (case.path_parameters or {})}
    case.path_parameters.update(known)
    if _MATCH in case.headers and "case_id" in known:
        etag = _session.case_etag(known["case_id"])
        case.headers[_MATCH] = (
            _CONTEXT["plan_etag"] if case.path.endswith("/approval") else etag or case.headers[_MATCH]
        )


@schemathesis.hook
def after_call(context: Any, case: Any, response: Any) -> None:
    """Count; and sign in again where the session has ended."""
    _answers[str(response.status_code)] += 1
    if response.status_code == 401 and any(code in response.text for code in _TOKEN_PROBLEMS):
        _session.sign_in()


@schemathesis.check
def within_role(ctx: Any, response: Any, case: Any) -> None:
    """Nobody gets what his role may not do: 401 or 403 is the answer, whatever else is wrong."""
    action = case.operation.definition.raw.get(_ACTION)
    if response.status_code < 400 and action not in _CONTEXT["actions"]:
        answered = f"{case.method} {case.path} was answered with {response.status_code}"
        sentence = f"{answered}, and '{action}' is not for {_CONTEXT['name']}"
        _beyond.append(sentence)
        raise AssertionError(sentence)


def _write() -> None:
    Path(_CONTEXT["tally"]).write_text(json.dumps({"answers": _answers, "beyond": _beyond}), encoding="utf-8")


atexit.register(_write)

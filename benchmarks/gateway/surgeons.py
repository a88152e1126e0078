"""A surgeon at a console, who does what a seeded script says, and notes every answer."""

import json
import random
import time
import uuid
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from threading import Barrier
from typing import Final

import httpx

from benchmarks.gateway.race_judgement import ActionName, Answer
from distalock.rest_client import RestClient, bearer

PASSWORD: Final = "four words and a nail"  # noqa: S105 - of accounts that end with the benchmark
_ANSWER_S: Final = 60.0
_EXPIRED: Final = "token_expired"
# Chosen: beside motions of about half a second.
_LONGEST_PAUSE_S: Final = 0.15
_FIRST_APPROVES: Final = 0.8
_REPEATS: Final = 0.15
_WEIGHTS: Final[dict[ActionName, float]] = {"move": 4.0, "approve": 1.5, "undo": 1.5, "stop": 1.5}
_MOST_TURNS: Final = 4


@dataclass(frozen=True, slots=True)
class Turn:
    """One action after a pause; `twice` sends it again under the same key, as an impatient page does."""

    pause_s: float
    action: ActionName
    twice: bool


def script(source: random.Random) -> tuple[Turn, ...]:
    """What one surgeon does in one race."""
    actions: list[ActionName] = ["approve"] if source.random() < _FIRST_APPROVES else []
    actions += source.choices(tuple(_WEIGHTS), tuple(_WEIGHTS.values()), k=source.randint(1, _MOST_TURNS))
    return tuple(Turn(source.uniform(0.0, _LONGEST_PAUSE_S), one, source.random() < _REPEATS) for one in actions)


@dataclass(slots=True)
class Surgeon:
    """One of the two, signed in with an account of his own."""

    name: str
    http: httpx.Client
    case_id: str
    refresh_token: str = ""
    answers: list[Answer] = field(default_factory=list)

    def play(self, turns: Sequence[Turn], plan: int, etag: str, start: Barrier) -> None:
        """Take one's turns, from the moment when both are there."""
        start.wait()
        for turn in turns:
            time.sleep(turn.pause_s)
            key = "" if turn.action in ("undo", "stop") else str(uuid.uuid4())
            request = self._request(turn.action, plan, etag, key)
            for _ in range(2 if turn.twice and key else 1):
                self._note(turn.action, key, self._sent(request))

    def sign_in(self) -> None:
        """Begin a session."""
        self._take_over(self.http.post("/api/v1/sessions", json={"name": self.name, "password": PASSWORD}))

    def _renew(self) -> None:
        """Go on with a session whose access has ended, as it does after a quarter of an hour."""
        self._take_over(self.http.post("/api/v1/sessions/refresh", json={"refresh_token": self.refresh_token}))

    def _take_over(self, answer: httpx.Response) -> None:
        tokens = answer.raise_for_status().json()
        self.http.headers.update(bearer(str(tokens["access_token"])))
        self.refresh_token = str(tokens["refresh_token"])

    def _request(self, action: ActionName, plan: int, etag: str, key: str) -> httpx.Request:
        case, headers = f"/api/v1/cases/{self.case_id}", {"Idempotency-Key": key} if key else {}
        match action:
            case "approve":
                return self.http.build_request(
                    "POST",
                    f"{case}/plans/{plan}/approval",
                    json={"password": PASSWORD},
                    headers={**headers, "If-Match": etag},
                )
            case "move":
                read = self._sent(self.http.build_request("GET", case)).headers["etag"]
                body = {"plan": plan}
                quoted = {**headers, "If-Match": read}
                return self.http.build_request("POST", f"{case}/motions", json=body, headers=quoted)
            case "undo":
                return self.http.build_request("DELETE", f"{case}/plans/{plan}/approval")
            case "stop":
                return self.http.build_request("POST", "/api/v1/robot/stop")

    def _sent(self, request: httpx.Request) -> httpx.Response:
        """The answer; where access has ended, to the same request after the session was renewed."""
        response = self.http.send(request)
        if response.status_code == httpx.codes.UNAUTHORIZED and _code_of(response) == _EXPIRED:
            self._renew()
            request.headers["Authorization"] = self.http.headers["Authorization"]
            response = self.http.send(request)
        return response

    def _note(self, action: ActionName, key: str, response: httpx.Response) -> None:
        detail = str(_content(response).get("detail") or "")
        code = _code_of(response)
        self.answers.append(Answer(self.name, action, key, response.status_code, code, detail, response.text))


def _content(response: httpx.Response) -> dict[str, object]:
    with suppress(json.JSONDecodeError):
        content = response.json()
        return content if isinstance(content, dict) else {}
    return {}


def _code_of(response: httpx.Response) -> str:
    return str(_content(response).get("code") or "")


def new_surgeon(rest: RestClient, url: str, name: str, case_id: str) -> Surgeon:
    """Make an account and sign in with it."""
    rest.post("/api/v1/users", {"name": name, "password": PASSWORD, "roles": ["surgeon"]})
    surgeon = Surgeon(name, httpx.Client(base_url=url, timeout=_ANSWER_S), case_id)
    surgeon.sign_in()
    return surgeon

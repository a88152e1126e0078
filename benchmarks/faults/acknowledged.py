"""What the installation has acknowledged, and what of it is lost: requests over REST, and images by DICOM."""

import re
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeVar

import httpx
from pydantic import BaseModel

from distalock.case_client import CaseClient
from distalock.client import Client, RequestRefused
from distalock.client.call import Call
from distalock.client.models import ImageView
from distalock.installation import Installation
from distalock.rest_client import JsonObject, RestClient

_WAIT_S: Final = 10.0
_CASE: Final = r"/api/v1/cases/(?P<case>[^/]+)"
_LOST: Final = "not_found"
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Kept:
    """Where an answered request is found again: `find` gets the pattern's groups and the answer."""

    pattern: re.Pattern[str]
    path: Callable[[str, JsonObject], str]
    holds: Callable[[JsonObject, JsonObject], bool]


def _same(name: str) -> Callable[[JsonObject, JsonObject], bool]:
    return lambda answer, found: found[name] == answer[name]


def _operation(_: str, answer: JsonObject) -> str:
    return f"/api/v1/operations/{answer['id']}"


_KEPT: Final = (
    _Kept(re.compile(r"/api/v1/cases"), lambda path, answer: f"{path}/{answer['id']}", _same("id")),
    _Kept(re.compile(rf"{_CASE}/plans"), lambda path, answer: f"{path}/{answer['number']}", _same("sha256")),
    _Kept(
        re.compile(rf"{_CASE}/plans/\d+/approval"),
        lambda path, _: path.removesuffix("/approval"),
        lambda _, plan: plan["approval"] is not None,
    ),
    _Kept(re.compile(rf"{_CASE}/verifications"), lambda path, answer: f"{path}/{answer['number']}", _same("verdict")),
    _Kept(re.compile(rf"{_CASE}/motions"), _operation, _same("id")),
    _Kept(re.compile(r"/api/v1/robot/(acknowledge-stop|reference|reset)"), _operation, _same("id")),
)


@dataclass(slots=True)
class Acknowledged:
    """Everything that was answered with success so far.

    Attributes
    ----------
    answers
        Path and answer of each request that acts.
    images
        SOP instance UIDs of the images that imaging has acknowledged.
    """

    answers: list[tuple[str, JsonObject]] = field(default_factory=list)
    images: list[str] = field(default_factory=list)

    def lost_answers(self, rest: RestClient) -> list[str]:
        """Paths of requests whose effect is not there any more."""
        return [path for path, answer in self.answers if not _is_kept(rest, path, answer)]

    def steps_lost(self, record: Path) -> int:
        """How many of the steps that people did with their hands are not on record."""
        acknowledged = sum(path.endswith("/steps") for path, _ in self.answers)
        return max(acknowledged - len(_events(record, "step_recorded")), 0)

    def images_not_on_record(self, record: Path) -> list[str]:
        """Images of which the record does not know."""
        known = "\n".join(_events(record, "image_received"))
        return [uid for uid in self.images if uid not in known]

    def unfinished_images(self, case: CaseClient) -> list[str]:
        """Images of a case that are neither localised nor explained.

        A frame of running fluoroscopy is explained by being one: of a run, those are localised that guidance needs.
        """
        return [
            one.sop_instance_uid
            for one in case.images()
            if one.sop_instance_uid in self.images and one.localisation is None and not _is_explained(one)
        ]


class AcknowledgingClient(Client):
    """A client that remembers what it was answered."""

    def __init__(
        self, url: str, token: str, acknowledged: Acknowledged, answer_s: float, http: httpx.Client | None = None
    ) -> None:
        super().__init__(url, token, answer_s, http)
        self._acknowledged = acknowledged

    @classmethod
    def of(cls, installation: Installation, acknowledged: Acknowledged, answer_s: float) -> "AcknowledgingClient":
        """A client of an installation of processes."""
        return cls(installation.ports.rest_url, installation.token, acknowledged, answer_s)

    def send(self, call: Call[T]) -> T:
        """Act, and remember the answer."""
        answer = super().send(call)
        if not call.reads_only and isinstance(answer, BaseModel):
            self._acknowledged.answers.append((call.path, answer.model_dump(mode="json")))
        return answer


def _is_explained(image: ImageView) -> bool:
    in_run = image.header is not None and image.header.run_interval_s is not None
    return in_run or image.skipped is not None


def _events(record: Path, kind: str) -> list[str]:
    """Data of all events of a kind, as JSON."""
    with closing(sqlite3.connect(record, timeout=_WAIT_S)) as connection:
        rows = connection.execute("SELECT data_json FROM events WHERE kind = ?", (kind,)).fetchall()
    return [data for (data,) in rows]


def _is_kept(rest: RestClient, path: str, answer: JsonObject) -> bool:
    for kept in _KEPT:
        if kept.pattern.fullmatch(path):
            try:
                return kept.holds(answer, rest.get(kept.path(path, answer)))
            except RequestRefused as refusal:
                if not refusal.problem_code.endswith(_LOST):
                    raise
                return False
    return True

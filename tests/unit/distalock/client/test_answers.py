"""Lines to events, answers to refusals, and what a client makes of what it does not know."""

import json

import pytest

from distalock.client.answer import RawAnswer
from distalock.client.base import ReceivedModel
from distalock.client.call import Call
from distalock.client.event_models import PresenceChanged
from distalock.client.events import Event, EventLines
from distalock.client.models import CasePatch, HealthView, StepBody
from distalock.client.refusals import AnswerInvalid
from distalock.client.session import Session

HEAD = {"sequence": 7, "at_ns": 8, "case_id": None, "who": "robot", "why": ""}


def sent(kind: str, data: object) -> str:
    return json.dumps({**HEAD, "kind": kind, "data": data})


def heard(*lines: str, end: str = "\r\n", chunk: int = 1000) -> list[Event]:
    put_together, sent_bytes = EventLines(), "".join(line + end for line in lines).encode()
    chunks = (sent_bytes[start : start + chunk] for start in range(0, len(sent_bytes), chunk))
    return [event for one in chunks for event in put_together.received(one)]


def test_lines_become_events_and_comments_none() -> None:
    text = sent("presence_changed", {"service": "robot", "alive": False, "since": "a newer gateway"})
    (event,) = heard(": ping", "", "id: 7", "event: presence_changed", f"data: {text}", "")
    assert (event.sequence, event.data) == (7, PresenceChanged(service="robot", alive=False))


def test_an_event_over_several_lines_is_one() -> None:
    half, rest = sent("presence_changed", {"service": "robot", "alive": True}).split(", ", 1)
    assert [event.who for event in heard(f"data: {half},", f"data:{rest}", "")] == ["robot"]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("chunk", [1, 2, 7, 1000])
def test_a_text_with_other_ends_of_lines_is_one_line(end: str, chunk: int) -> None:
    why = "first\u2028second\u0085third\x1c\u00e9"
    text = json.dumps({**HEAD, "why": why, "kind": "invented_later", "data": {}}, ensure_ascii=False)
    lines = (f"data: {text}", "")
    assert [event.why for event in heard(*lines, *lines, end=end, chunk=chunk)] == [why, why]


def test_a_kind_of_event_that_is_not_known_comes_as_it_is() -> None:
    assert Event.of_json(sent("invented_later", {"what": 1})).data == {"what": 1}


def test_an_event_that_is_none_is_said_to_be_none() -> None:
    with pytest.raises(AnswerInvalid, match="sequence"):
        Event.of_json('{"kind": "presence_changed"}')


def test_a_refusal_has_document_etag_and_time() -> None:
    document = {"type": "t", "title": "t", "status": 429, "detail": "wait", "code": "slow_down", "instance": "/x"}
    headers = {"content-type": "application/problem+json", "retry-after": "3"}
    refusal = RawAnswer(429, headers, json.dumps(document).encode()).refusal("/x")
    assert refusal is not None
    assert (refusal.problem_code, refusal.status, refusal.retry_after_s, str(refusal)) == (
        "slow_down",
        429,
        3.0,
        "wait",
    )


def test_a_refusal_of_a_proxy_is_one_too() -> None:
    refusal = RawAnswer(502, {"content-type": "text/html"}, b"<h1>upstream").refusal("/x")
    assert refusal is not None
    assert (refusal.problem_code, refusal.status) == ("unknown", 502)
    assert "upstream" in str(refusal)
    assert RawAnswer(304, {}, b"").refusal("/x") is None


def test_an_answer_that_is_not_documented_names_the_call() -> None:
    with pytest.raises(AnswerInvalid, match=r"GET /healthz.*version"):
        Call("GET", "/healthz", HealthView).answered(b'{"status": "ok"}')


def test_a_change_sends_what_was_set_and_nothing_else() -> None:
    assert Call("PATCH", "/x", HealthView, body=CasePatch(side="right")).content == b'{"side":"right"}'
    assert (
        Call("PATCH", "/x", HealthView, body=CasePatch(nominal_pixel_mm=None)).content == b'{"nominal_pixel_mm":null}'
    )


def test_a_misspelt_member_is_refused_before_it_is_sent() -> None:
    with pytest.raises(ValueError, match="holes"):
        StepBody.model_validate({"step": "drilled", "holes": ["distal"]})


def test_what_is_received_keeps_nothing_that_it_does_not_know() -> None:
    assert ReceivedModel.model_validate({"later": 1}).model_dump() == {}


@pytest.mark.parametrize(("path", "renewed"), [("/api/v1/cases", True), ("/api/v1/robot/stop", False)])
def test_a_stop_waits_for_no_renewal(*, path: str, renewed: bool) -> None:
    assert Session("access", "refresh", 100.0).must_be_renewed(path, lambda: 99.0) is renewed


def test_a_token_that_was_given_is_never_renewed() -> None:
    assert not Session("access").must_be_renewed("/api/v1/cases", lambda: 1e9)

"""Lines of Zenoh's router, as they were seen: what of them is a refusal."""

import pytest

from shared.bus.router_log import LogLine, Refusal, RouterLogReader
from shared.messages.refusals import LONGEST_TEXT, RefusalCode

STATE = "distalock/v1/or1/robot/state"
IMAGING = "5bd13dc2758f402caee01aff3bb6c2cb"
GATEWAY = "f1970b22ea194acf2aae01181b6bac67"


def line(text: str, thread: int = 10, level: str = "TRACE", target: str = "access_control") -> str:
    where = f"rx-0 ThreadId({thread}) zenoh::net::routing::interceptor"
    return f"2026-11-25T07:02:46.589538Z {level:>5}  {where}{'::' if target else ''}{target}: {text}"


def decided(
    what: str, *, allowed: bool = False, session: str = IMAGING, name: str = "imaging", thread: int = 10
) -> str:
    subject = f"Interface(lo)+CertCommonName({name})+Transport(Tls)+{session}"
    return line(f"{session} on {subject} is {'' if allowed else 'un'}authorized to {what}", thread)


def cached(what: str, *, allowed: bool = False, session: str = IMAGING, thread: int = 10) -> str:
    return line(f"Using cached result: {session} is {'' if allowed else 'un'}authorized to {what}", thread)


def intercepted(thread: int = 10) -> str:
    return line("Msg intercepted!", thread, target="")


def of_link(text: str, level: str = "WARN") -> str:
    return f"2026-11-25T07:04:38.027366Z {level:>5} acc-0 ThreadId(08) zenoh_link_tls::unicast: {text}"


def refusals(*lines: str) -> list[Refusal]:
    reader = RouterLogReader()
    seen = [reader.read(one) for one in lines]
    assert not any(isinstance(one, LogLine) for one in seen)
    return [one for one in seen if isinstance(one, Refusal)]


def denied(what: str, key: str, service: str = "imaging") -> Refusal:
    return Refusal(RefusalCode.MESSAGE_DENIED, service, what, key)


def test_a_denied_message_is_a_refusal_of_its_sender() -> None:
    assert refusals(decided(f"Put (ingress) on {STATE}"), intercepted()) == [denied("Put", STATE)]


def test_decisions_that_are_made_ahead_are_none() -> None:
    ahead = [decided(f"{what} (ingress) on {STATE}") for what in ("Query", "Reply", "Put", "Delete")]
    assert refusals(*ahead, cached(f"Declare Subscriber (ingress) on {STATE}", allowed=True)) == []


def test_a_denial_from_what_was_decided_ahead_names_the_sender_all_the_same() -> None:
    ahead, then = decided(f"Query (ingress) on {STATE}"), cached(f"Declare Subscriber (ingress) on {STATE}")
    assert refusals(ahead, then, intercepted()) == [denied("Declare Subscriber", STATE)]


def test_what_is_withheld_from_a_service_is_the_ordinary_work_of_the_rules() -> None:
    assert refusals(decided(f"Put (egress) on {STATE}"), intercepted()) == []


def test_an_allowed_message_on_the_same_thread_leaves_nothing_behind() -> None:
    lines = (decided(f"Put (ingress) on {STATE}"), decided(f"Put (ingress) on {STATE}", allowed=True), intercepted())
    assert refusals(*lines) == []


def test_threads_are_told_apart() -> None:
    lines = (
        decided(f"Put (ingress) on {STATE}", thread=10),
        decided(f"Query (ingress) on {STATE}", session=GATEWAY, name="ui_api", thread=11),
        intercepted(10),
        intercepted(11),
    )
    assert refusals(*lines) == [denied("Put", STATE), denied("Query", STATE, "ui_api")]


@pytest.mark.parametrize("key", ["**", "a key/with (ingress) on words", "x" * 5000])
def test_keys_may_be_anything(key: str) -> None:
    assert refusals(decided(f"Put (ingress) on {key}"), intercepted()) == [denied("Put", key[:LONGEST_TEXT])]


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (
            "invalid peer certificate: certificate expired: verification time 1795590277 (UNIX), but ...",
            "invalid peer certificate: certificate expired",
        ),
        ("invalid peer certificate: UnknownIssuer", "invalid peer certificate: UnknownIssuer"),
        (
            "received corrupt message of type InvalidContentType",
            "received corrupt message of type InvalidContentType",
        ),
    ],
)
def test_a_refused_link_says_why_and_not_when(said: str, reason: str) -> None:
    assert refusals(of_link(f"{said}. Hint: increase the system open file limit.")) == [
        Refusal(RefusalCode.LINK_REFUSED, "", reason)
    ]


def test_who_only_asks_whether_somebody_listens_is_not_refused() -> None:
    reader = RouterLogReader()
    assert reader.read(of_link("tls handshake eof. Hint: increase the system open file limit.")) is None


def test_a_name_without_rules_is_on_record_with_its_link() -> None:
    accepted = "Accepted TLS connection on 127.0.0.1:39113: 127.0.0.1:57270. Common Name: {}."
    lines = [of_link(accepted.format(name), "DEBUG") for name in ("robot", "stranger")]
    assert refusals(*lines) == [Refusal(RefusalCode.UNKNOWN_NAME, "stranger", "no rules for this name")]


def test_warnings_of_zenoh_and_what_is_no_line_of_it_are_for_people() -> None:
    reader = RouterLogReader()
    for text in (line("a lock was poisoned", level="ERROR", target="x"), "thread panicked at src/lib.rs"):
        assert reader.read(text) == LogLine(text)
    assert reader.read(line("fine", level="DEBUG", target="x")) is None
    assert reader.read("") is None

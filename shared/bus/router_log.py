"""Finds in the lines that Zenoh's router logs what it has refused.

Zenoh reports each decision of its access control at the level of traces, and no other way. Decisions are made ahead,
too, for every key that a session names; only one that is followed, on the same thread, by the interception of a message
has denied something. What is withheld from a service ("egress") is the ordinary work of the rules: services subscribe
to one key and the router would offer them others. What a service sent ("ingress") and was denied is a refusal.
"""

import re
from collections import OrderedDict
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from shared.bus.access import CLIENTS
from shared.messages.refusals import LONGEST_TEXT, RefusalCode

# What must be logged for this reader, as a filter of Zenoh's.
NEEDED_TARGETS: Final = "zenoh::net::routing::interceptor=trace,zenoh_link_tls=debug"
_INTERCEPTOR: Final = "zenoh::net::routing::interceptor"
_ACCESS_CONTROL: Final = f"{_INTERCEPTOR}::access_control"
_TLS: Final = "zenoh_link_tls"
# Chosen: many times the sessions of a room; beyond it the name of the one that was silent longest is forgotten.
_MOST_SESSIONS: Final = 256
_LINE: Final = re.compile(
    r"^\S+Z +(?P<level>[A-Z]+) +(?P<thread>.*?ThreadId\(\d+\)) (?P<target>[\w:]+): (?P<text>.*)$", re.DOTALL
)
_DECISION: Final = re.compile(
    r"^(?:Using cached result: )?(?P<session>[0-9a-f]+)(?: on (?P<subject>\S+))? is (?P<un>un)?authorized to "
    r"(?P<what>[^(]+) \((?P<flow>ingress|egress)\) on (?P<key>.*)$",
    re.DOTALL,
)
_NAME: Final = re.compile(r"CertCommonName\(([^)]*)\)")
_ACCEPTED: Final = re.compile(r"^Accepted TLS connection .*\. Common Name: (?P<name>.*)\.$")
_HINT: Final = re.compile(r"\. Hint: .*$")
# Moments in a sentence would make every attempt another one.
_MOMENT: Final = re.compile(r": verification time .*$")
# A connection that ends before it has said anything, as of a program that asks whether somebody listens.
_SAID_NOTHING: Final = ("tls handshake eof", "unexpected end of file", "Connection reset by peer")


@dataclass(frozen=True, slots=True)
class Refusal:
    """One refusal: what `BusRefusal` says, seen once."""

    code: RefusalCode
    service: str
    what: str
    key: str = ""


@dataclass(frozen=True, slots=True)
class LogLine:
    """A line that is for people."""

    text: str


@dataclass(frozen=True, slots=True)
class _Denied:
    session: str
    what: str
    key: str


class RouterLogReader:
    """Takes line after line, as they were written.

    Parameters
    ----------
    clients
        Common names of those who have rules.
    """

    def __init__(self, clients: Collection[str] = CLIENTS) -> None:
        self._clients = frozenset(clients)
        self._denied: dict[str, _Denied] = {}
        self._names: OrderedDict[str, str] = OrderedDict()

    def read(self, line: str) -> Refusal | LogLine | None:
        """What a line is: a refusal, something for people, or None for ordinary work."""
        match = _LINE.match(line)
        if match is None:
            return LogLine(line) if line.strip() else None
        level, thread, target, text = match.groups()
        if target == _ACCESS_CONTROL:
            self._note_decision(thread, text)
            return None
        if target == _INTERCEPTOR:
            return self._intercepted(thread)
        if target.startswith(_TLS):
            said_nothing = any(said in text for said in _SAID_NOTHING)
            return None if said_nothing else _of_link(level, text, self._clients) or _for_people(level, line)
        return _for_people(level, line)

    def _note_decision(self, thread: str, text: str) -> None:
        match = _DECISION.match(text)
        if match is None:
            self._denied.pop(thread, None)
            return
        session, subject = match["session"], match["subject"]
        if subject is not None and (name := _NAME.search(subject)) is not None:
            self._names[session] = name[1]
            self._names.move_to_end(session)
            if len(self._names) > _MOST_SESSIONS:
                self._names.popitem(last=False)
        if match["un"] is not None and match["flow"] == "ingress":
            self._denied[thread] = _Denied(session, match["what"], match["key"])
        else:
            self._denied.pop(thread, None)

    def _intercepted(self, thread: str) -> Refusal | None:
        """The decision just before on this thread was about a message.

        There is none for a session of an unknown name, to which no rule applies: its link is on record.
        """
        denied = self._denied.pop(thread, None)
        if denied is None:
            return None
        name = self._names.get(denied.session, "")
        return Refusal(
            RefusalCode.MESSAGE_DENIED, name[:LONGEST_TEXT], denied.what[:LONGEST_TEXT], denied.key[:LONGEST_TEXT]
        )


def _of_link(level: str, text: str, clients: Collection[str]) -> Refusal | None:
    accepted = _ACCEPTED.match(text)
    if accepted is not None:
        name = accepted["name"]
        known = name in clients
        return None if known else Refusal(RefusalCode.UNKNOWN_NAME, name[:LONGEST_TEXT], "no rules for this name")
    if level != "WARN" or _HINT.search(text) is None or any(said in text for said in _SAID_NOTHING):
        return None
    reason = _MOMENT.sub("", _HINT.sub("", text))
    return Refusal(RefusalCode.LINK_REFUSED, "", reason[:LONGEST_TEXT])


def _for_people(level: str, line: str) -> LogLine | None:
    return LogLine(line) if level in ("WARN", "ERROR") else None

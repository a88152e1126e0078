"""The router's access control, made from the table: what Zenoh must let through so that a row works, and no more.

Rules are the router's: "ingress" is what a service sends to it, "egress" what it sends to a service. A retained key
needs more than its own name: its publisher also answers for the last value, shows itself with a token and sends the
newest sequence number under ``KEY/@adv/pub/{session}/{entity}/_``.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from shared.bus.access import Exchange, Row

Flow = Literal["ingress", "egress"]
_PUBLISHERS: Final = "/@adv/pub/*/*/_"
_ANY_PUBLISHER: Final = "/@adv/**"


@dataclass(frozen=True, slots=True)
class _Grant:
    flow: Flow
    messages: tuple[str, ...]
    suffix: str = ""


_PROVIDER: Final[dict[Exchange, tuple[_Grant, ...]]] = {
    Exchange.STREAM: (_Grant("ingress", ("put",)), _Grant("egress", ("declare_subscriber",))),
    Exchange.RETAINED: (
        _Grant("ingress", ("put", "reply")),
        _Grant("ingress", ("put", "declare_queryable", "liveliness_token"), _PUBLISHERS),
        _Grant("egress", ("declare_subscriber",)),
        _Grant("egress", ("query", "declare_subscriber"), _ANY_PUBLISHER),
    ),
    Exchange.QUERY: (_Grant("ingress", ("declare_queryable", "reply")), _Grant("egress", ("query",))),
    Exchange.TOKEN: (_Grant("ingress", ("liveliness_token",)),),
}
_CONSUMER: Final[dict[Exchange, tuple[_Grant, ...]]] = {
    Exchange.STREAM: (_Grant("ingress", ("declare_subscriber",)), _Grant("egress", ("put",))),
    Exchange.RETAINED: (
        _Grant("ingress", ("declare_subscriber",)),
        _Grant("ingress", ("query", "declare_subscriber", "declare_liveliness_subscriber"), _ANY_PUBLISHER),
        _Grant("egress", ("put", "reply")),
        _Grant("egress", ("put", "liveliness_token"), _PUBLISHERS),
    ),
    Exchange.QUERY: (_Grant("ingress", ("query",)), _Grant("egress", ("reply",))),
    Exchange.TOKEN: (
        _Grant("ingress", ("declare_liveliness_subscriber",)),
        _Grant("egress", ("liveliness_token",)),
    ),
}


def access_control(table: Sequence[Row], clients: Sequence[str]) -> dict[str, object]:
    """Zenoh's `access_control`: everything is denied but what a client's rows need.

    A client is who its certificate's common name says.
    """
    rules, policies = [], []
    for client in clients:
        own = list(_rules_of(client, table))
        rules += own
        policies.append({"id": client, "subjects": [client], "rules": [rule["id"] for rule in own]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": client, "cert_common_names": [client]} for client in clients],
        "policies": policies,
    }


def _rules_of(client: str, table: Sequence[Row]) -> Iterator[dict[str, object]]:
    for exchange in Exchange:
        rows = [row for row in table if row.exchange is exchange]
        provided = [row for row in rows if row.provider == client]
        consumed = [row for row in rows if client in row.consumers]
        for part, own, grants in (("provides", provided, _PROVIDER), ("consumes", consumed, _CONSUMER)):
            for number, grant in enumerate(grants[exchange] if own else ()):
                yield {
                    "id": f"{client} {part} {exchange} {number}",
                    "permission": "allow",
                    "flows": [grant.flow],
                    "messages": list(grant.messages),
                    "key_exprs": [key + grant.suffix for key in _keys(own, part, grant.flow)],
                }


def _keys(rows: Sequence[Row], part: str, flow: Flow) -> tuple[str, ...]:
    """A provider speaks on its own key alone; of consumers it hears by the expression that they named."""
    by_key = part == "provides" and flow == "ingress"
    return tuple(dict.fromkeys(row.key if by_key else row.subscribed_as or row.key for row in rows))

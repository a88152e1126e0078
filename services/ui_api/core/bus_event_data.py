"""What events of the bus itself say: one frozen dataclass per kind."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RefusedOnBus:
    """What one sender tried in one way on one key; `service` is its certificate's name, empty without a link."""

    code: str
    service: str
    what: str
    key: str
    times: int
    last_at_ns: int


@dataclass(frozen=True, slots=True)
class BusRefused:
    """The router refused links or messages: those that were not on record yet, each with how often until now.

    Attributes
    ----------
    router_epoch
        A run of the router.
    messages_denied, links_refused, unknown_names
        In this run until now, also those that are not named here.
    gaps
        How often in this run refusals came faster than they could be counted.
    """

    router_epoch: str
    messages_denied: int
    links_refused: int
    unknown_names: int
    gaps: int
    refusals: tuple[RefusedOnBus, ...]

"""How a program reaches the bus."""

from dataclasses import dataclass

from shared.bus.tls import TlsFiles


@dataclass(frozen=True, slots=True)
class BusSettings:
    """Where the router is, how long to wait for it, and what proves there who this program is.

    Attributes
    ----------
    tls
        None for an endpoint without TLS.
    """

    endpoint: str
    open_timeout_s: float = 10.0
    tls: TlsFiles | None = None

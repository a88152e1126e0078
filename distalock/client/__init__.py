"""A typed client of the gateway's REST interface, for consoles and programs: `docs/client.md`.

`Client` answers at once, `AsyncClient` is awaited; both have a method for each operation of `docs/openapi.json`. Models
of what is sent and received are in `distalock.client.models`, of what events carry in `distalock.client.event_models`.
"""

from distalock.client.async_client import AsyncClient
from distalock.client.events import Event
from distalock.client.refusals import AnswerInvalid, RequestRefused
from distalock.client.sync_client import Client

__all__ = ["AnswerInvalid", "AsyncClient", "Client", "Event", "RequestRefused"]

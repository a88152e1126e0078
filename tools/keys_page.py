"""`docs/keys.md`: the key space, and who may do what in it."""

from shared.bus.access import CLIENTS, Exchange, Row, access_table
from shared.bus.keys import PREFIX, Keys

_ROOM = "{room}"
_HEAD = """# Key space of the bus

`distalock/v1/{room}/{service}/...`. The keys are written once, in `shared/bus/keys.py`; the messages are in
`shared/messages/`, their
JSON schemas in `shared/messages/schemas/`. Who may do what stands in `shared/bus/access.py`: the router's rules, this
page (`make generated`) and the tests are
made from that table. Whatever is not in it is denied.

| exchange | the provider | the consumers |
|---|---|---|
| stream | publishes | receive what comes from now on |
| retained | publishes; the last value is kept | receive the last value too, however late they subscribe |
| query | answers | ask |
| liveliness token | holds it while it is connected | see it come and go |

A service is who its certificate says (`docs/decisions/0027-keys-and-certificates.md`): the router takes links under
mutual TLS alone, and goes by the certificate's common name.
`*` stands for one part of a key. All processes of the gateway are `ui_api`. `exporter` shows the room to the hospital's
control desk and sends nothing ([decision 57](decisions/0057-many-rooms.md)).

| key | exchange | provider | consumers | message |
|---|---|---|---|---|
"""
_MIDDLE = """
## Service by service

| service | publishes | receives | answers | asks | holds tokens | watches tokens |
|---|---|---|---|---|---|---|
"""
_RULES = """
Rules
- A command begins with what its client has *seen*: it quotes the robot's boot epoch and the newest state sequence it
  received
  (`docs/decisions/0003-late-commands.md`).
- What moves the robot carries a permit that the gateway has signed (`docs/decisions/0028-permits-to-move.md`): that the
  router lets a
  command through is not enough. The plan itself comes from `registration/plan` alone.
- No reply, or an error reply, never means "not carried out". What the access control denies is not answered either;
  it is on record (`docs/decisions/0037-what-the-router-refuses.md`).
- A result names what it was made from: the image's hash, the part files' hashes, the case's revision, the software's
  version, and the
  registration epoch. A new image or a changed set-up makes a new epoch; whatever quotes an older one moves nothing.
- The robot takes the newest epoch from `registration/epoch` alone, which registration publishes the moment an image
  arrives, long before
  its localisation. When no epoch was confirmed within the last second, nothing begins to move.
"""


def keys_page() -> str:
    """The page."""
    table = access_table(Keys(_ROOM))
    by_key = "".join(_row(row) for row in table)
    by_service = "".join(_service_row(service, table) for service in CLIENTS)
    return _HEAD + by_key + _MIDDLE + by_service + _RULES


def _row(row: Row) -> str:
    consumers = ", ".join(sorted(row.consumers)) or "nobody"
    return f"| `{_short(row)}` | {row.exchange} | {row.provider} | {consumers} | {row.carries} |\n"


def _service_row(service: str, table: tuple[Row, ...]) -> str:
    published, answered, tokens = (Exchange.STREAM, Exchange.RETAINED), (Exchange.QUERY,), (Exchange.TOKEN,)
    cells = []
    for exchanges in (published, answered, tokens):
        rows = [row for row in table if row.exchange in exchanges]
        cells.append(_names([row for row in rows if row.provider == service]))
        cells.append(_names([row for row in rows if service in row.consumers]))
    return f"| {service} | " + " | ".join(cells) + " |\n"


def _names(rows: list[Row]) -> str:
    return ", ".join(f"`{_short(row)}`" for row in rows) or "nothing"


def _short(row: Row) -> str:
    return row.key.removeprefix(f"{PREFIX}/{_ROOM}/")

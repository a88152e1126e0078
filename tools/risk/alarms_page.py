"""`docs/risk/alarms.md`: the gateway's table of alarm conditions."""

from typing import Final

from services.ui_api.core.alarms import PRIORITY, TABLE, Onset, Result
from tools.risk.tables import NOT_A_DEVICE, table

_HEAD: Final = f"""{NOT_A_DEVICE} This page is printed by `make generated` from `services/ui_api/core/alarms.py`, by
which `GET /alarms` answers: every condition that holds now, the most urgent first, each with what
was measured and what to do. A console shows and sounds them. Priorities follow table 1 of IEC
60601-1-8: what may come of it when nobody responds, and how soon. An alarm lasts as long as its
condition; what must outlast it is latched by the robot (a stop, a fault). Signals, their loudness
and their silencing are the console's. An alarm adds no control: what it tells of has stopped or
refused the motion already ([hazards](hazards.md))."""


def alarms_page() -> str:
    """The page."""
    scale = ((result, *(PRIORITY[result, onset] for onset in Onset)) for result in Result)
    rows = ((f"`{one.code}`", one.priority, one.means, f"{one.result}, {one.onset}", one.remedy) for one in TABLE)
    return "\n".join(
        [
            "# Alarms",
            "",
            _HEAD,
            "",
            *table(("when nobody responds", *Onset), scale),
            "",
            *table(("code", "priority", "condition", "may come of it", "what to do"), rows),
            "",
        ]
    )

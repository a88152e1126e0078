"""The program on the client's page runs as it stands there."""

import os
import re
import subprocess
import sys
from pathlib import Path

from services.ui_api.core.roles import Role
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.people import PASSWORD, add_account
from tests.unit.services.ui_api.room import open_room, wait_until

_PAGE = Path(__file__).parents[3] / "docs" / "client.md"


def test_the_program_leads_a_case_to_the_approved_plan(tmp_path: Path) -> None:
    (program,) = re.findall(r"```python\n(.*?)```", _PAGE.read_text(encoding="utf-8"), re.DOTALL)
    with open_room(tmp_path) as room:
        add_account(room, "ada", Role.SURGEON)
        who = {
            "DISTALOCK_URL": str(room.client.base_url),
            "DISTALOCK_USER": "ada",
            "DISTALOCK_PASSWORD": PASSWORD,
        }
        with subprocess.Popen(
            [sys.executable, "-c", program], env={**os.environ, **who}, stdout=subprocess.PIPE, text=True
        ) as running:
            try:
                wait_until(lambda: bool(room.gateway.record.ledger.cases) or running.poll() is not None)
                (case_id,) = room.gateway.record.ledger.cases
                room.image("first", case_id)
                said, _ = running.communicate(timeout=PATIENCE_S)
            finally:
                running.kill()
        assert running.returncode == 0
        assert "ada case_opened" in said
        assert "distal (" in said
        assert room.gateway.record.ledger.cases[case_id].plans[0].approval is not None, said

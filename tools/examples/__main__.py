"""Record the examples anew, from a simulation on this machine: `make examples`; some minutes.

An example stays as it is while its shape does; `--all` replaces every one.
"""

import argparse
import json
import sys
import tempfile
import threading
from pathlib import Path

import httpx

from distalock.case_client import CaseClient
from distalock.client import Client
from distalock.installation import Installation, Ports
from distalock.rest_client import RestClient
from distalock.room_client import RoomClient
from services.ui_api.api_document.examples import EXAMPLES
from services.ui_api.app import openapi_document, routed_app
from tools.examples.kept import with_changed
from tools.examples.procedure import Recording
from tools.examples.recorder import Recorder

_SEED = 2


def main() -> int:
    """Start a simulation, lead a case, and write what was answered."""
    parser = argparse.ArgumentParser(prog="python -m tools.examples", description="record the examples of the API")
    parser.add_argument("--all", action="store_true", help="replace every example, not those alone whose shape changed")
    before = {} if parser.parse_args().all else json.loads(EXAMPLES.read_text(encoding="utf-8"))
    recorder = Recorder(openapi_document(routed_app()))
    with tempfile.TemporaryDirectory() as folder:
        installation = Installation(Ports.any_free(), Path(folder), scenario_arguments=("--seed", str(_SEED)))
        url = installation.gateway.url
        with (
            installation.fleet(threading.Event()),
            httpx.Client(event_hooks={"response": [recorder.on_answer]}, timeout=300.0) as http,
            Client(url, installation.token, http=http) as recorded,
            Client(url, installation.token) as plain,
            RestClient(installation.ports.control_url) as control,
        ):
            room = RoomClient(control)
            case = CaseClient.opened(plain, room.scenario().set_up)
            case.follow(plain.acknowledge_stop())
            case.follow(recorded.reference_robot())
            case.record_step("abandoned", why="the next one is recorded")
            Recording(recorder, recorded, plain, room).run()
    examples = with_changed(before, recorder.examples)
    replaced = [name for name in examples if examples[name] != before.get(name)]
    EXAMPLES.write_text(json.dumps(examples, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"{len(examples)} examples in {EXAMPLES}; recorded anew: {', '.join(replaced) or 'none'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

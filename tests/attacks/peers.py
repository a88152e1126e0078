"""Programs of an attacker on the bus: one that plays the router, one that listens and invites, one that hears all."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import zenoh

from shared.bus.router import DEFAULT_CONFIG, Protection, router_config, running_router
from shared.bus.settings import BusSettings
from shared.bus.tls import TlsFiles
from shared.bus.zenoh_bus import client_config
from tests.attacks.site import ROOM, Site, silence
from tests.contract.bus.rooms import free_port

NOTHING_PASSES: Final = "nothing passes"


def overheard_or_forged(site: Site, stranger: zenoh.Session) -> str:
    """Listen to everything, and speak as the robot; what came of it."""
    forged = b"forged"
    overheard: list[zenoh.Sample] = []
    taken: list[bytes] = []
    with site.open_as("ui_api") as gateway, stranger.declare_subscriber("**", overheard.append):
        gateway.subscribe(site.keys.robot_state, lambda sample: taken.append(sample.payload))
        stranger.put(site.keys.robot_state, forged)
        silence()
    # A session hears what it says itself without the router.
    if any(sample.payload.to_bytes() != forged for sample in overheard):
        return "it listened"
    if not taken:
        return "the robot's own states did not come"
    return "it was heard" if forged in taken else NOTHING_PASSES


@contextmanager
def router_with(files: TlsFiles) -> Iterator[str]:
    """A router that runs with somebody's files; its endpoint."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with running_router(router_config(DEFAULT_CONFIG, [endpoint], Protection.of_room(files, ROOM))):
        yield endpoint


def peer_past_the_router(site: Site) -> str:
    """It has a service's own certificate, listens, invites everybody, and still is that service at the router."""
    config = client_config(BusSettings(site.endpoint, tls=site.files_of("imaging")))
    values: dict[str, object] = {
        "mode": "peer",
        "listen/endpoints": [f"tcp/127.0.0.1:{free_port()}"],
        "scouting/multicast/enabled": True,
        "scouting/gossip/enabled": True,
        "scouting/gossip/multihop": True,
    }
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as peer:
        silence()
        return overheard_or_forged(site, peer)


def listen_to_all(site: Site) -> str:
    with site.open_as("imaging") as bus:
        return overheard_or_forged(site, bus._session)

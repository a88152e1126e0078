"""Attacks with a stolen key on the keys of its own service: garbage, floods, tokens, heartbeats, states, epochs."""

import threading
import time
import uuid
from collections.abc import Callable
from typing import Final

import zenoh

from shared.bus.access import Exchange, access_table
from shared.messages.base import encode
from shared.messages.presence import Heartbeat
from shared.messages.registration import RegistrationEpoch
from tests.attacks.attack import Attack, Record
from tests.attacks.commands import Thief, as_thief
from tests.attacks.site import PATIENCE_S, Site, silence, wait_until

_SERVED: Final = "others are served"
_LARGE_BYTES: Final = 10 * 2**20
_BEATS: Final = 100
_FRAMES: Final = 30
_FRAME_BYTES: Final = 2_000_000


def _garbage(service: str) -> Callable[[Site], str]:
    """What is no message, on each key that the service publishes."""

    def run(site: Site) -> str:
        streams = (Exchange.STREAM, Exchange.RETAINED)
        own = [row for row in access_table(site.keys) if row.provider == service and row.exchange in streams]
        with site.open_as(service) as bus:
            for row in own:
                for garbage in (b"", b"\xff\x00", b"{}", b"[" * 10_000, uuid.uuid4().bytes):
                    bus._session.put(row.key, garbage, attachment=garbage)
            silence()
        return _served(site)

    return run


def _served(site: Site) -> str:
    wait_until(lambda: site.rest.get("/api/v1/robot")["validity"] == "current", "a current state", PATIENCE_S)
    return _SERVED


def _large(site: Site) -> str:
    with site.open_as("imaging") as bus:
        for _ in range(5):
            bus._session.put(site.keys.frame, bytes(_LARGE_BYTES), attachment=b"{}")
        silence()
    return _served(site)


def _never_reads(site: Site) -> str:
    """A subscriber with the gateway's key that takes the first frame for ever, while frames and commands go on."""
    ending = threading.Event()

    def hold(_sample: zenoh.Sample) -> None:
        ending.wait(PATIENCE_S)

    with (
        site.open_as("ui_api") as reader,
        site.open_as("imaging") as imaging,
        reader._session.declare_subscriber(site.keys.frame, hold),
    ):
        silence()
        for _ in range(_FRAMES):
            imaging._session.put(site.keys.frame, bytes(_FRAME_BYTES))
        seen = _served(site)
        ending.set()
    return seen


def _stolen_token(site: Site) -> str:
    """Hold the gateway's token and let it go: for the robot the gateway has gone, and at rest that is all."""
    with site.open_as("ui_api") as bus:
        for _ in range(5):
            token = bus.declare_alive(site.keys.alive("ui_api"))
            silence()
            token.close()
    return f"the robot is {site.robot()['state']}"


def _heartbeats(site: Site) -> str:
    """Signs of life of a gateway that does not exist, beside the true ones."""
    with site.open_as("ui_api") as bus:
        publisher = bus.publisher(site.keys.heartbeat("ui_api"))
        for sequence in range(_BEATS):
            publisher.put(encode(Heartbeat(service="ui_api", boot_epoch="forged", sequence=sequence)))
            time.sleep(0.01)
    return f"the robot is {site.robot()['state']}"


def _forged_state(thief: Thief) -> str:
    """States of the robot that it never published, and a command that quotes them."""
    forged = thief.state.model_copy(update={"sequence": thief.state.sequence + 10**6})
    with thief.site.open_as("robot") as robot:
        publisher = robot.publisher(thief.site.keys.robot_state)
        publisher.put(encode(forged))
    return thief.acknowledge(after_state_sequence=forged.sequence)


def _forged_epoch(site: Site) -> str:
    """Registration claims that nothing is newer than an epoch of its own: every plan of before is then stale."""
    forged = RegistrationEpoch(boot_epoch="forged", sequence=1, registration_epoch="forged")
    with site.open_as("registration") as bus:
        publisher = bus.publisher(site.keys.registration_epoch)
        for _ in range(20):
            publisher.put(encode(forged))
            time.sleep(0.01)
    return f"the robot is {site.robot()['state']}"


def _key(service: str) -> str:
    return f"{service}'s key"


_LOCKED: Final = "the robot is locked"

ATTACKS: Final = (
    *(
        Attack(
            f"malformed messages of {service}",
            _key(service),
            "what is no message, on every key that it publishes",
            _SERVED,
            Record(hearer, "not a valid"),
            _garbage(service),
        )
        for service, hearer in (("imaging", "registration"), ("registration", "robot"), ("robot", "ui_api"))
    ),
    Attack(
        "large messages",
        _key("imaging"),
        "five frames of 10 MiB that are none",
        _SERVED,
        Record("registration", "not a valid"),
        _large,
    ),
    Attack(
        "subscriber that never reads",
        _key("ui_api"),
        f"take the first of {_FRAMES} frames for ever",
        _SERVED,
        None,
        _never_reads,
    ),
    Attack("stolen token", _key("ui_api"), "hold the gateway's token and let it go", _LOCKED, None, _stolen_token),
    Attack(
        "forged heartbeats", _key("ui_api"), f"{_BEATS} signs of life of another gateway", _LOCKED, None, _heartbeats
    ),
    Attack(
        "forged state",
        "the robot's key, and the gateway's",
        "a state that the robot never published, and a command that quotes it",
        "state_not_published",
        Record("robot", "state_not_published"),
        as_thief(_forged_state),
    ),
)

# From here on the robot believes no epoch of before, so that nothing moves until registration is started anew.
FORGED_EPOCH: Final = Attack(
    "forged registration epoch", _key("registration"), "an epoch of its own as the newest", _LOCKED, None, _forged_epoch
)

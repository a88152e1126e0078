"""Who gets no link at the router, and whom a service takes for no router."""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh

from shared.bus.access import SERVICES, access_table
from shared.bus.keys import Keys
from shared.bus.port import Sample
from shared.bus.router import Protection, router_config, running_router
from shared.bus.shared_memory import MemoryLimits, shared_memory_shortage
from shared.bus.tls import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, TlsFiles
from shared.bus.zenoh_bus import BusSettings, client_config, open_bus
from shared.errors import BusUnavailable
from shared.pki.authority import CERTIFICATE_VALID, Identity, Use, issue, new_authority
from shared.pki.keystore import Keystore
from tests.contract.bus.rooms import Collector, eventually, free_port
from tests.contract.security.rooms import ROOM, SecureRoom

KEYS = Keys(ROOM)
NOW = datetime.now(UTC)
# Handshakes took 5 ms where nothing else ran; a refused one is tried again until this has passed.
REFUSED_WITHIN_S = 1.5
SILENCE_S = 0.7
LONG_AGO = NOW - CERTIFICATE_VALID - timedelta(days=1)


def authority_of(keystore: Keystore) -> Identity:
    folder = keystore.folder / "authority"
    return Identity((folder / KEY_FILE).read_bytes(), (folder / AUTHORITY_FILE).read_bytes())


def written(folder: Path, identity: Identity, trusted: Identity) -> TlsFiles:
    """The files of an identity that trusts an authority."""
    for name, content in (
        (KEY_FILE, identity.key_pem),
        (CERTIFICATE_FILE, identity.certificate_pem),
        (AUTHORITY_FILE, trusted.certificate_pem),
    ):
        (folder / name).write_bytes(content)
        (folder / name).chmod(0o600)
    return TlsFiles.in_folder(folder)


Forgery = Callable[[Identity], Identity]
FORGERIES: dict[str, Forgery] = {
    "expired": lambda authority: issue(authority, "robot", Use.CLIENT, (), LONG_AGO),
    "not valid yet": lambda authority: issue(authority, "robot", Use.CLIENT, (), NOW + timedelta(days=2)),
    "of another authority": lambda _: issue(new_authority(NOW), "robot", Use.CLIENT, (), NOW),
    "signed by itself": lambda _: new_authority(NOW),
    "of a server": lambda authority: issue(authority, "robot", Use.SERVER, ("localhost",), NOW),
}


@pytest.mark.requirement("SEC-01")
@pytest.mark.parametrize("name", FORGERIES)
def test_a_certificate_that_does_not_count_gets_no_link(room: SecureRoom, tmp_path: Path, name: str) -> None:
    authority = authority_of(room.keystore)
    files = written(tmp_path, FORGERIES[name](authority), authority)
    with pytest.raises(
        BusUnavailable, match=f"no router answered at {room.endpoint} within 1.5 s; .* the certificates"
    ):
        open_bus(BusSettings(room.endpoint, REFUSED_WITHIN_S, files))


def test_a_certificate_with_another_key_gets_no_link(room: SecureRoom, tmp_path: Path) -> None:
    """What is public of the robot, with a key of somebody else."""
    authority, robot = authority_of(room.keystore), room.files_of("robot")
    mixed = Identity(room.files_of("imaging").key.read_bytes(), robot.certificate.read_bytes())
    with pytest.raises(BusUnavailable):
        open_bus(BusSettings(room.endpoint, REFUSED_WITHIN_S, written(tmp_path, mixed, authority)))


@pytest.mark.requirement("SEC-01")
def test_a_link_ends_with_its_certificate(room: SecureRoom, tmp_path: Path) -> None:
    authority = authority_of(room.keystore)
    ends_soon = issue(
        authority, "imaging", Use.CLIENT, (), datetime.now(UTC) - CERTIFICATE_VALID + timedelta(seconds=4)
    )
    files = written(tmp_path, ends_soon, authority)
    with open_bus(BusSettings(room.endpoint, REFUSED_WITHIN_S, files)) as imaging:
        assert imaging.link_up()
        eventually(lambda: not imaging.link_up())


@pytest.mark.requirement("SEC-01")
def test_without_a_certificate_there_is_no_link(room: SecureRoom) -> None:
    config = client_config(BusSettings(room.endpoint))
    config.insert_json5("transport/link/tls/root_ca_certificate", json.dumps(str(room.files_of("robot").authority)))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def test_without_tls_there_is_no_link(room: SecureRoom) -> None:
    with pytest.raises(BusUnavailable):
        open_bus(BusSettings(room.endpoint.replace("tls/", "tcp/"), REFUSED_WITHIN_S))


def test_a_certificate_of_an_unknown_name_may_do_nothing(room: SecureRoom, tmp_path: Path) -> None:
    """The authority may sign for others one day; the table does not know them."""
    authority = authority_of(room.keystore)
    files = written(tmp_path, issue(authority, "stranger", Use.CLIENT, (), NOW), authority)
    heard: Collector[Sample] = Collector()
    with room.open_as("robot") as robot, room.open_as("ui_api") as gateway:
        gateway.subscribe(KEYS.robot_state, heard.add)
        with open_bus(BusSettings(room.endpoint, REFUSED_WITHIN_S, files)) as stranger:
            assert nothing_passes(stranger._session, robot._session, heard)


def nothing_passes(stranger: zenoh.Session, robot: zenoh.Session, heard: Collector[Sample]) -> bool:
    """Whether a session neither hears the robot nor is heard in its name."""
    overheard: list[zenoh.Sample] = []
    with stranger.declare_subscriber("**", overheard.append):
        stranger.put(KEYS.robot_state, b"forged")
        robot.put(KEYS.robot_state, b"true")
        threading.Event().wait(SILENCE_S)
        # A session hears what it says itself without the router.
        only_itself = all(sample.payload.to_bytes() == b"forged" for sample in overheard)
        return only_itself and [sample.payload for sample in heard.items] == [b"true"]


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_a_peer_that_listens_reaches_nobody_past_the_router(room: SecureRoom, mode: str) -> None:
    """It has a service's own certificate, listens, invites everybody, and still is that service at the router."""
    heard: Collector[Sample] = Collector()
    with (
        room.open_as("robot") as robot,
        room.open_as("ui_api") as gateway,
        zenoh.open(inviting(room, mode)) as peer,
    ):
        gateway.subscribe(KEYS.robot_state, heard.add)
        threading.Event().wait(SILENCE_S)
        assert nothing_passes(peer, robot._session, heard)
        for bus in (robot, gateway):
            assert bus._session.info.peers_zid() == []
            assert len(bus._session.info.routers_zid()) == 1


def inviting(room: SecureRoom, mode: str) -> zenoh.Config:
    """Configuration of a program that does all it can to have others connect to it."""
    config = client_config(BusSettings(room.endpoint, tls=room.files_of("imaging")))
    values: dict[str, object] = {
        "mode": mode,
        "listen/endpoints": [f"tcp/127.0.0.1:{free_port()}"],
        "scouting/multicast/enabled": True,
        "scouting/gossip/enabled": True,
        "scouting/gossip/multihop": True,
    }
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


@contextmanager
def impostor(files: TlsFiles) -> Iterator[str]:
    """A router that runs with somebody's files."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    config = router_config(Path("shared/bus/router.json5"), [endpoint], Protection.of_room(files, ROOM))
    with running_router(config):
        yield endpoint


@pytest.mark.parametrize("name", SERVICES)
def test_no_service_can_play_the_router(room: SecureRoom, name: str) -> None:
    with impostor(room.files_of(name)) as endpoint, pytest.raises(BusUnavailable):
        open_bus(BusSettings(endpoint, REFUSED_WITHIN_S, room.files_of("robot")))


def test_a_router_of_another_authority_is_not_believed(room: SecureRoom, tmp_path: Path) -> None:
    other = new_authority(NOW)
    files = written(tmp_path, issue(other, "router", Use.SERVER, ("127.0.0.1",), NOW), other)
    with impostor(files) as endpoint, pytest.raises(BusUnavailable):
        open_bus(BusSettings(endpoint, REFUSED_WITHIN_S, room.files_of("robot")))


def test_a_router_of_another_host_is_not_believed(room: SecureRoom, tmp_path: Path) -> None:
    authority = authority_of(room.keystore)
    files = written(tmp_path, issue(authority, "router", Use.SERVER, ("elsewhere",), NOW), authority)
    with impostor(files) as endpoint, pytest.raises(BusUnavailable):
        open_bus(BusSettings(endpoint, REFUSED_WITHIN_S, room.files_of("robot")))


def test_the_router_of_another_room_carries_nothing(room: SecureRoom) -> None:
    other = {row.key for row in access_table(Keys("other"))}
    with room.open_as("ui_api") as gateway, room.open_as("robot") as robot:
        heard: Collector[Sample] = Collector()
        for key in other:
            gateway.subscribe(key, heard.add)
            robot._session.put(key.replace("*", "some"), b"from another room")
        threading.Event().wait(SILENCE_S)
        assert heard.items == []


def test_frames_go_by_shared_memory_under_tls_too(room: SecureRoom) -> None:
    """The first may find the pool not yet mapped."""
    if (shortage := shared_memory_shortage(MemoryLimits.of_this_process())) is not None:
        pytest.skip(shortage)
    shared: Collector[bool] = Collector()
    with room.open_as("imaging") as imaging, room.open_as("ui_api") as gateway:
        frames = imaging.publisher(KEYS.frame)

        def note(sample: zenoh.Sample) -> None:
            shared.add(sample.payload.as_shm() is not None)

        with gateway._session.declare_subscriber(KEYS.frame, note):
            for _ in range(40):  # streams may drop
                frames.put(bytes(2_000_000))
                threading.Event().wait(0.03)
            shared.wait_until(20)
    assert shared.items.count(True) >= 0.8 * len(shared.items), shared.items

"""What the bus promises about samples."""

import threading

from shared.bus.port import Sample
from tests.contract.bus.rooms import PATIENCE_S, Collector, Room, until_known


def test_sample_arrives_whole(room: Room) -> None:
    got: Collector[Sample] = Collector()
    with room.open() as sender, room.open() as receiver:
        publisher = sender.publisher("whole/a")
        receiver.subscribe("whole/a", got.add)
        until_known(receiver, sender)
        publisher.put(b"", b"")
        got.wait_for(Sample("whole/a", b"", b""))
        publisher.put(b"payload", b"header")
        got.wait_for(Sample("whole/a", b"payload", b"header"))


def test_who_has_no_use_for_payloads_gets_attachments(room: Room) -> None:
    got: Collector[bytes] = Collector()
    with room.open() as sender, room.open() as receiver:
        publisher = sender.publisher("whole/b")
        receiver.subscribe_attachments("whole/b", got.add)
        until_known(receiver, sender)
        for attachment in (b"", b"header"):
            publisher.put(b"payload", attachment)
            got.wait_for(attachment)


def test_frames_of_four_megabytes_arrive(room: Room) -> None:
    got: Collector[tuple[int, bytes]] = Collector()
    arrived = threading.Event()

    def handler(sample: Sample) -> None:
        got.add((len(sample.payload), sample.attachment))
        arrived.set()

    with room.open() as sender, room.open() as receiver:
        publisher = sender.publisher("frame/a")
        receiver.subscribe("frame/a", handler)
        until_known(receiver, sender)
        for _ in range(5):  # streams may drop, and on a busy machine the first frame of a session sometimes is
            publisher.put(bytes(4 * 1024 * 1024), b"header")
            if arrived.wait(PATIENCE_S / 15):
                break
    assert set(got.items) == {(4 * 1024 * 1024, b"header")}


def test_wildcards_cover_one_chunk_or_many(room: Room) -> None:
    one: Collector[str] = Collector()
    many: Collector[str] = Collector()
    with room.open() as sender, room.open() as receiver:
        publishers = {key: sender.publisher(key) for key in ("wild/a/x", "wild/a/b/x", "other/a/x", "wild/end/x")}
        receiver.subscribe("wild/*/x", lambda s: one.add(s.key))
        receiver.subscribe("wild/**", lambda s: many.add(s.key))
        until_known(receiver, sender)
        for publisher in publishers.values():
            publisher.put(b"1")
        one.wait_for("wild/end/x")
        many.wait_for("wild/end/x")
    assert one.items == ["wild/a/x", "wild/end/x"]
    assert many.items == ["wild/a/x", "wild/a/b/x", "wild/end/x"]


def test_streams_keep_nothing_for_late_joiners(room: Room) -> None:
    got: Collector[bytes] = Collector()
    with room.open() as sender, room.open() as receiver:
        publisher = sender.publisher("late/stream")
        publisher.put(b"before")
        until_known(sender, receiver)
        receiver.subscribe("late/stream", lambda s: got.add(s.payload))
        until_known(receiver, sender)
        publisher.put(b"after")
        got.wait_for(b"after")
    assert got.items == [b"after"]


def test_retained_value_reaches_late_joiners_once(room: Room) -> None:
    got: Collector[Sample] = Collector()
    with room.open() as sender, room.open() as receiver:
        publisher = sender.retained_publisher("late/state")
        publisher.put(b"old", b"1")
        publisher.put(b"last", b"2")
        until_known(sender, receiver)
        receiver.subscribe_retained("late/*", got.add)
        got.wait_for(Sample("late/state", b"last", b"2"))
        publisher.put(b"next")
        got.wait_for(Sample("late/state", b"next", b""))
    assert [s.payload for s in got.items] == [b"last", b"next"]


def test_retained_value_arrives_when_the_publisher_comes_later(room: Room) -> None:
    got: Collector[bytes] = Collector()
    with room.open() as receiver:
        receiver.subscribe_retained("later/state", lambda s: got.add(s.payload))
        with room.open() as sender:
            sender.retained_publisher("later/state").put(b"hello")
            got.wait_for(b"hello")


def test_plain_subscriber_sees_retained_publications(room: Room) -> None:
    got: Collector[bytes] = Collector()
    with room.open() as sender, room.open() as receiver:
        publisher = sender.retained_publisher("plain/state")
        receiver.subscribe("plain/state", lambda s: got.add(s.payload))
        until_known(receiver, sender)
        publisher.put(b"now")
        got.wait_for(b"now")


def test_closed_subscription_gets_nothing(room: Room) -> None:
    closed: Collector[bytes] = Collector()
    still: Collector[bytes] = Collector()
    with room.open() as sender, room.open() as receiver:
        publisher = sender.publisher("closed/a")
        subscription = receiver.subscribe("closed/a", lambda s: closed.add(s.payload))
        receiver.subscribe("closed/a", lambda s: still.add(s.payload))
        subscription.close()
        subscription.close()
        until_known(receiver, sender)
        publisher.put(b"1")
        still.wait_for(b"1")
    assert closed.items == []


def test_raising_handler_goes_on(room: Room) -> None:
    got: Collector[bytes] = Collector()

    def handler(sample: Sample) -> None:
        got.add(sample.payload)
        raise RuntimeError("handler")

    with room.open() as sender, room.open() as receiver:
        publisher = sender.publisher("raising/a")
        receiver.subscribe("raising/a", handler)
        until_known(receiver, sender)
        publisher.put(b"1")
        publisher.put(b"2")
        got.wait_for(b"2")
    assert got.items == [b"1", b"2"]


def test_hung_handler_stalls_neither_publisher_nor_its_own_session(room: Room) -> None:
    hung = threading.Event()
    release = threading.Event()
    newest: Collector[bytes] = Collector()
    others: Collector[bytes] = Collector()

    def hang(sample: Sample) -> None:
        newest.add(sample.payload)
        hung.set()
        release.wait(PATIENCE_S)

    with room.open() as sender, room.open() as receiver:
        frames, state = sender.publisher("hung/frame"), sender.publisher("hung/state")
        receiver.subscribe("hung/frame", hang)
        receiver.subscribe("hung/state", lambda s: others.add(s.payload))
        until_known(receiver, sender)
        frames.put(b"first")
        assert hung.wait(PATIENCE_S)
        for number in range(2000):
            frames.put(b"%d" % number)
        until_known(receiver, sender)
        frames.put(b"newest")
        state.put(b"alive")
        others.wait_for(b"alive")
        release.set()
        newest.wait_for(b"newest")
    assert len(newest.items) < 2000, "a hung handler's backlog must be bounded"


def test_retained_value_put_without_link_arrives_after_it(own_room: Room) -> None:
    got: Collector[bytes] = Collector()
    with own_room.open() as sender, own_room.open() as receiver:
        publisher = sender.retained_publisher("gap/state")
        publisher.put(b"before")
        receiver.subscribe_retained("gap/state", lambda s: got.add(s.payload))
        got.wait_for(b"before")
        own_room.cut()
        publisher.put(b"during")
        own_room.restore()
        got.wait_for_last(b"during")

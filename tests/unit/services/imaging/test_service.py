"""Imaging on an in-memory bus: images in, frames and calibrations out."""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
import structlog
from pydicom import dcmread

from services.imaging.devices.c_arm_memory import CArmMemory
from services.imaging.devices.image_file import read_image
from services.imaging.devices.image_index import ImageIndex
from services.imaging.devices.image_store import ImageStore
from services.imaging.devices.position_store import PositionStore
from services.imaging.devices.received_image import Polarity
from services.imaging.service import Calibrator, Defaults, ImagingService, calibrator
from services.imaging.service.headers import Arrival, ImageNumber, frame_header
from services.imaging.service.quality_handler import QualityHandler
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Bus, Sample
from shared.errors import ImageUnreadable, NoReply
from shared.geometry.calibration import CArmCalibration
from shared.messages.base import decode, encode
from shared.messages.cases import CaseContext
from shared.messages.imaging import CalibrationMessage, FrameHeader
from shared.messages.presence import ServiceStatus
from shared.messages.qa import QaReply, QaRequest
from shared.messages.stored_images import Skip, SkipCode, Step, StoredImage, StoredImagesReply, StoredImagesRequest
from shared.runtime.clock import Clock
from shared.runtime.lifecycle import Runtime
from shared.runtime.presence import StatusReporter
from tests.unit.services.imaging.devices.dicom_samples import dataset_of, file_of, grey_ramp
from tests.unit.services.imaging.synthetic import RING_FILE, Scene, default_ring, render

KEYS = Keys("or1")
PATIENCE_S = 60.0


@dataclass(frozen=True)
class Room:
    """The service with someone who listens to it."""

    bus: Bus
    service: ImagingService
    frames: "queue.Queue[Sample]"
    calibrations: "queue.Queue[Sample]"
    statuses: "queue.Queue[ServiceStatus]"

    def open_case(self, **changes: object) -> None:
        context = {"case_id": "case-1", "revision": 3, "ring_json": RING_FILE.read_text(), **changes}
        self.bus.retained_publisher(KEYS.case_context).put(encode(CaseContext.model_validate(context)))
        self.wait_for("ready" if "detail" not in changes else "degraded")

    def wait_for(self, condition: str) -> ServiceStatus:
        while True:
            status = self.statuses.get(timeout=PATIENCE_S)
            if status.condition == condition:
                return status

    def calibration(self) -> CalibrationMessage:
        return decode(CalibrationMessage, self.calibrations.get(timeout=PATIENCE_S).payload)


@contextmanager
def room_of(
    store: ImageStore,
    positions: Path,
    memory: CArmMemory | None = None,
    run_interval_s: float = PATIENCE_S,
    polarity: Polarity = Polarity.AS_TAGGED,
    clock: Clock | None = None,
) -> Iterator[Room]:
    router = MemoryRouter()
    with router.open() as bus, router.open() as listener:
        status = StatusReporter(bus.retained_publisher(KEYS.status("imaging")), "imaging", "epoch-1", "0")
        log: structlog.stdlib.BoundLogger = structlog.stdlib.get_logger("test")
        runtime = Runtime("imaging", "epoch-1", KEYS, log, status)
        quality = QualityHandler(store, positions / "qa", lambda: datetime(2026, 1, 2, tzinfo=UTC))
        service = ImagingService(
            bus,
            runtime,
            store,
            Calibrator(bus, runtime, store, memory or CArmMemory(PositionStore(positions))),
            quality,
            Defaults(1000.0, 0.235, polarity),
            run_interval_s,
            clock or Clock(),
        )
        frames: queue.Queue[Sample] = queue.Queue()
        calibrations: queue.Queue[Sample] = queue.Queue()
        statuses: queue.Queue[ServiceStatus] = queue.Queue()
        listener.subscribe(KEYS.frame, frames.put)
        listener.subscribe_retained(KEYS.calibration, calibrations.put)
        listener.subscribe_retained(KEYS.status("imaging"), lambda s: statuses.put(decode(ServiceStatus, s.payload)))
        with service.running():
            yield Room(listener, service, frames, calibrations, statuses)


def stored(room: Room, after: int = 0) -> list[StoredImage]:
    """What imaging answers to whoever asks for what was missed."""
    request = encode(StoredImagesRequest(after=after))
    reply = decode(StoredImagesReply, room.bus.query(KEYS.stored_images, request, PATIENCE_S).payload)
    return list(reply.images)


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Room]:
    with room_of(ImageStore(tmp_path), tmp_path / "positions") as built:
        yield built


def eventually(condition: Callable[[], bool]) -> None:
    """Ask again until it holds."""
    pause = threading.Event()
    for _ in range(1000):
        if condition():
            return
        pause.wait(0.02)
    raise AssertionError("never came true")


def small_dicom() -> bytes:
    dataset = dataset_of(grey_ramp())
    dataset.ImagerPixelSpacing, dataset.DistanceSourceToDetector = [0.3, 0.3], 950.0
    return file_of(dataset)


def test_a_frame_is_published_with_its_header_and_fetched_again_by_hash(room: Room) -> None:
    room.service.take(small_dicom(), "CARM")
    sample = room.frames.get(timeout=PATIENCE_S)
    header = decode(FrameHeader, sample.attachment)
    assert (header.pixels(sample.payload) == grey_ramp()).all()
    assert (header.sequence, header.boot_epoch, header.case_id) == (1, "epoch-1", None)
    assert (header.nominal_pixel_mm, header.nominal_source_to_detector_mm) == (0.3, 950.0)
    answer = room.bus.query(KEYS.frame_by_hash(header.sha256), b"", PATIENCE_S)
    assert answer.payload == sample.payload
    again = decode(FrameHeader, answer.attachment)
    assert again.model_copy(update={"age_s": header.age_s}) == header
    assert header.age_s is not None
    assert again.age_s is not None
    assert 0.0 <= header.age_s <= again.age_s


def test_a_frame_is_still_there_after_a_restart(tmp_path: Path) -> None:
    with room_of(ImageStore(tmp_path), tmp_path / "positions") as before:
        before.service.take(small_dicom(), "CARM")
        sample = before.frames.get(timeout=PATIENCE_S)
    sha256 = decode(FrameHeader, sample.attachment).sha256
    with room_of(ImageStore(tmp_path), tmp_path / "positions") as after:
        answer = after.bus.query(KEYS.frame_by_hash(sha256), b"", PATIENCE_S)
    assert answer.payload == sample.payload
    again = decode(FrameHeader, answer.attachment)
    assert again.age_s is None, "no clock has run since it was received"
    assert again == decode(FrameHeader, sample.attachment).model_copy(update={"age_s": None})


def test_an_unknown_hash_is_an_error_reply(room: Room) -> None:
    with pytest.raises(NoReply, match="no image with SHA-256 000"):
        room.bus.query(KEYS.frame_by_hash("0" * 64), b"", PATIENCE_S)


def test_an_image_of_an_open_case_is_calibrated(room: Room) -> None:
    room.open_case()
    rendered = render(Scene(seed=21, mirrored=True), default_ring())
    room.service.take(bytes(cv2.imencode(".png", rendered.pixels.astype(np.uint16))[1]), "file")
    message = room.calibration()
    assert (message.verdict, message.reasons) == ("accepted", ())
    assert (message.case_id, message.case_revision) == ("case-1", 3)
    assert message.ring_sha256 == default_ring().sha256
    assert message.values is not None
    calibration = message.values.calibration()
    assert calibration.mirrored
    source = calibration.camera_from_ring.inverse().translation_mm
    assert np.abs(source - rendered.source_mm).max() < 1.0
    header = decode(FrameHeader, room.frames.get(timeout=PATIENCE_S).attachment)
    assert message.image.sha256 == header.sha256
    assert header.case_revision == 3


class HeldMemory(CArmMemory):
    """Holds the calibration of the first image until it is released."""

    def __init__(self, positions: Path) -> None:
        super().__init__(PositionStore(positions))
        self.begun, self.released = threading.Event(), threading.Event()

    def before(self, ring_sha256: str, angles_deg: tuple[float, float] | None) -> CArmCalibration | None:
        self.begun.set()
        assert self.released.wait(PATIENCE_S)
        return super().before(ring_sha256, angles_deg)


def test_frames_of_a_run_are_published_at_once_and_those_overtaken_not_calibrated(tmp_path: Path) -> None:
    memory = HeldMemory(tmp_path / "positions")
    with room_of(ImageStore(tmp_path), tmp_path / "positions", memory) as room:
        room.open_case()
        room.service.take(small_dicom(), "CARM")
        assert memory.begun.wait(PATIENCE_S)
        for _ in range(4):
            room.service.take(small_dicom(), "CARM")
        sequences = [decode(FrameHeader, room.frames.get(timeout=PATIENCE_S).attachment).sequence for _ in range(5)]
        assert (sequences, room.calibrations.empty()) == ([1, 2, 3, 4, 5], True)
        memory.released.set()
        assert [room.calibration().image.sequence for _ in range(2)] == [1, 5]
        eventually(lambda: [one.calibration for one in stored(room)] == ["done", *["skipped"] * 3, "done"])
        assert {one.skip.code for one in stored(room) if one.skip} == {"superseded"}


def marks_of_two_images(folder: Path, run_interval_s: float) -> list[float | None]:
    """`run_interval_s` of two images in the frame header and in the calibration message."""
    with room_of(ImageStore(folder), folder / "positions", run_interval_s=run_interval_s) as room:
        room.open_case()
        marks = []
        for _ in range(2):
            room.service.take(small_dicom(), "CARM")
            header = decode(FrameHeader, room.frames.get(timeout=PATIENCE_S).attachment)
            assert room.calibration().image == header.reference()
            marks.append(header.run_interval_s)
        return marks


def test_an_image_that_follows_another_closely_is_marked_as_part_of_a_run(tmp_path: Path) -> None:
    assert marks_of_two_images(tmp_path, PATIENCE_S) == [None, PATIENCE_S]


def test_images_with_a_pause_between_them_are_single_shots(tmp_path: Path) -> None:
    assert marks_of_two_images(tmp_path, 1e-9) == [None, None]


@pytest.mark.requirement("OPS-02")
@pytest.mark.parametrize(
    ("since_s", "run_interval_s"), [(0.0, 0.5), (0.499, 0.5), (0.5, None), (10.0, None), (-0.1, None)]
)
@pytest.mark.parametrize("stepped_s", [0, 3, -3, 3600, -3600])
def test_the_monotonic_time_since_the_image_before_decides(
    since_s: float, run_interval_s: float | None, stepped_s: int
) -> None:
    one, two = (ImageNumber("store-1", number, "epoch-1") for number in (1, 2))
    first = Arrival.after(None, one, (10**13, 100.0), 0.5)
    second = Arrival.after(first, two, (10**13 + stepped_s * 10**9, 100.0 + since_s), 0.5)
    assert (first.number.sequence, first.run_interval_s) == (1, None)
    assert (second.number.sequence, second.run_interval_s) == (2, run_interval_s)


def test_a_refusal_is_published_with_its_reasons(room: Room) -> None:
    room.open_case()
    room.service.take(small_dicom(), "CARM")
    message = room.calibration()
    assert (message.verdict, message.values) == ("rejected", None)
    assert message.reasons[0].code == "image_unusable"
    assert "8 x 6 pixels" in message.reasons[0].message


def test_without_a_case_the_image_is_kept_but_not_calibrated(room: Room) -> None:
    room.service.take(small_dicom(), "CARM")
    room.frames.get(timeout=PATIENCE_S)
    room.open_case()
    room.service.take(small_dicom(), "CARM")
    room.frames.get(timeout=PATIENCE_S)
    assert room.calibration().image.sequence == 2
    assert room.calibrations.empty()


def test_images_are_numbered_without_a_gap_and_who_missed_them_may_ask(tmp_path: Path) -> None:
    for _ in range(2):
        with room_of(ImageStore(tmp_path), tmp_path / "positions", run_interval_s=0.0) as room:
            room.service.take(small_dicom(), "CARM")
            room.service.take(small_dicom(), "CARM")
            images = stored(room)
    assert [one.header.sequence for one in images] == [1, 2, 3, 4]
    assert len({one.header.store_id for one in images}) == 1
    assert [one.skip.code for one in images if one.skip] == ["no_case"] * 4
    assert [one.header.age_s for one in images] == [None] * 4, "sent again, an image does not become younger"


def test_who_asks_for_missed_images_gets_them_in_order_and_is_told_of_the_newest(room: Room) -> None:
    for _ in range(5):
        room.service.take(small_dicom(), "CARM")
    request = encode(StoredImagesRequest(after=1, most=2))
    reply = decode(StoredImagesReply, room.bus.query(KEYS.stored_images, request, PATIENCE_S).payload)
    assert ([one.header.sequence for one in reply.images], reply.newest) == ([2, 3], 5)


def test_a_missed_calibration_is_handed_out_by_number(room: Room) -> None:
    room.open_case()
    room.service.take(small_dicom(), "CARM")
    message = room.calibration()
    answer = room.bus.query(KEYS.calibration_of(message.image.sequence), b"", PATIENCE_S)
    assert decode(CalibrationMessage, answer.payload) == message
    with pytest.raises(NoReply, match="image number 2 has no calibration here"):
        room.bus.query(KEYS.calibration_of(2), b"", PATIENCE_S)


def left_behind(folder: Path, count: int) -> None:
    """Images of case 1 that a killed imaging has acknowledged and not calibrated."""
    store = ImageStore(folder)
    for sequence in range(1, count + 1):
        image = read_image(small_dicom(), "CARM")
        number = ImageNumber(store.index.store_id, sequence, "epoch-0")
        arrival = Arrival(number, 1, 1.0, None)
        context = CaseContext(case_id="case-1", revision=3)
        header = frame_header(image, store.put(image.dicom), arrival, context, Defaults(1000.0, 0.235))
        store.index.add(sequence, header.sha256, encode(header), in_run=False)


@pytest.mark.requirement("IMG-02")
def test_images_that_a_killed_imaging_left_behind_are_calibrated_the_newest_first(tmp_path: Path) -> None:
    left_behind(tmp_path, 3)
    with room_of(ImageStore(tmp_path), tmp_path / "positions") as room:
        assert [one.calibration for one in stored(room)] == ["pending"] * 3, "nobody knows yet which case is open"
        room.open_case()
        assert room.calibration().image.sequence == 3
        eventually(lambda: [one.calibration for one in stored(room)] == ["done"] * 3)
        assert room.calibrations.empty(), "the last value on the bus stays that of the newest image"
        assert stored(room)[0].header.age_s is None


@pytest.mark.parametrize("context", [{"revision": 4}, {"case_id": "case-2"}, {"case_id": None, "ring_json": ""}])
def test_images_left_behind_of_another_set_up_are_skipped_and_said_why(
    tmp_path: Path, context: dict[str, object]
) -> None:
    left_behind(tmp_path, 2)
    with room_of(ImageStore(tmp_path), tmp_path / "positions") as room:
        room.open_case(**context)
        eventually(lambda: [one.skip and one.skip.code for one in stored(room)] == ["set_up_changed"] * 2)
        assert room.calibrations.empty()


def test_an_image_that_ends_imaging_again_and_again_is_left_alone(tmp_path: Path) -> None:
    left_behind(tmp_path, 1)
    store = ImageStore(tmp_path)
    for _ in range(3):
        store.index.note_attempt(1)
    with room_of(store, tmp_path / "positions") as room:
        room.open_case()
        eventually(lambda: [one.skip and one.skip.code for one in stored(room)] == ["fault"])
        message = "imaging ended or lacked memory 3 times with it (limit 3); take another image"
        assert stored(room)[0].skip == Skip(step=Step.CALIBRATION, code=SkipCode.FAULT, message=message)


def test_an_image_whose_file_is_gone_is_said_so(tmp_path: Path) -> None:
    left_behind(tmp_path, 1)
    for file in tmp_path.rglob("*.dcm"):
        file.unlink()
    with room_of(ImageStore(tmp_path), tmp_path / "positions") as room:
        room.open_case()
        eventually(lambda: [one.skip and one.skip.code for one in stored(room)] == ["file_missing"])


class FailingMemory(CArmMemory):
    """Brings a fault with the first image."""

    def __init__(self, positions: Path, fault: Exception) -> None:
        super().__init__(PositionStore(positions))
        self.asked, self._fault = 0, fault

    def before(self, ring_sha256: str, angles_deg: tuple[float, float] | None) -> CArmCalibration | None:
        self.asked += 1
        if self.asked == 1:
            raise self._fault
        return super().before(ring_sha256, angles_deg)


def test_an_image_that_brings_a_fault_is_skipped_and_the_next_one_calibrated(tmp_path: Path) -> None:
    memory = FailingMemory(tmp_path / "positions", ZeroDivisionError("injected"))
    with room_of(ImageStore(tmp_path), tmp_path / "positions", memory, run_interval_s=0.0) as room:
        room.open_case()
        room.service.take(small_dicom(), "CARM")
        assert "brought a fault: injected; take another image" in room.wait_for("degraded").detail
        eventually(lambda: [one.skip and one.skip.code for one in stored(room)] == ["fault"])
        room.service.take(small_dicom(), "CARM")
        assert room.calibration().image.sequence == 2
        room.wait_for("ready")


def test_an_image_for_which_there_is_no_memory_waits_until_there_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory = FailingMemory(tmp_path / "positions", MemoryError("no 2 MiB"))
    lacking: list[str | None] = ["nothing is left"]
    monkeypatch.setattr(calibrator, "nearly_out_of_memory", lambda: lacking[0])
    monkeypatch.setattr(calibrator, "_MEMORY_AGAIN_S", 0.01)
    with room_of(ImageStore(tmp_path), tmp_path / "positions", memory, run_interval_s=0.0) as room:
        room.open_case()
        room.service.take(small_dicom(), "CARM")
        assert "waits for memory (no 2 MiB)" in room.wait_for("degraded").detail
        assert [one.skip for one in stored(room)] == [None]
        lacking[0] = None
        assert room.calibration().image.sequence == 1
        room.wait_for("ready")


def test_images_from_several_senders_at_once_are_numbered_without_a_gap(room: Room) -> None:
    def send() -> None:
        for _ in range(5):
            room.service.take(small_dicom(), "CARM")

    senders = [threading.Thread(target=send) for _ in range(4)]
    for one in senders:
        one.start()
    for one in senders:
        one.join()
    published = [decode(FrameHeader, room.frames.get(timeout=PATIENCE_S).attachment).sequence for _ in range(20)]
    assert published == list(range(1, 21))
    assert [one.header.sequence for one in stored(room)] == published


def test_a_single_shot_that_waited_is_calibrated_after_the_newest(tmp_path: Path) -> None:
    memory = HeldMemory(tmp_path / "positions")
    with room_of(ImageStore(tmp_path), tmp_path / "positions", memory, run_interval_s=0.0) as room:
        room.open_case()
        room.service.take(small_dicom(), "CARM")
        assert memory.begun.wait(PATIENCE_S)
        for _ in range(3):
            room.service.take(small_dicom(), "CARM")
        memory.released.set()
        assert [room.calibration().image.sequence for _ in range(2)] == [1, 4]
        eventually(lambda: [one.calibration for one in stored(room)] == ["done"] * 4)


def test_nominal_values_of_the_case_go_before_those_of_the_image(room: Room) -> None:
    room.open_case(nominal_pixel_mm=0.2, nominal_source_to_detector_mm=None)
    room.service.take(small_dicom(), "CARM")
    header = decode(FrameHeader, room.frames.get(timeout=PATIENCE_S).attachment)
    assert (header.nominal_pixel_mm, header.nominal_source_to_detector_mm) == (0.2, 950.0)


def test_what_is_not_an_image_is_refused_and_nothing_is_kept(room: Room, tmp_path: Path) -> None:
    with pytest.raises(ImageUnreadable, match="5 bytes that are not an image"):
        room.service.take(b"hello", "CARM")
    assert list(tmp_path.rglob("*.dcm")) == []
    assert stored(room) == []
    assert room.frames.empty()


def test_images_are_reversed_where_the_settings_say_so(tmp_path: Path) -> None:
    with room_of(ImageStore(tmp_path), tmp_path / "positions", polarity=Polarity.INVERTED) as room:
        room.service.take(small_dicom(), "CARM")
        sample = room.frames.get(timeout=PATIENCE_S)
        header = decode(FrameHeader, sample.attachment)
        assert header.inverted
        assert (header.pixels(sample.payload) == grey_ramp().max() - grey_ramp()).all()
        assert room.bus.query(KEYS.frame_by_hash(header.sha256), b"", PATIENCE_S).payload == sample.payload


def test_a_header_that_cannot_be_right_is_refused_until_the_case_states_the_value(room: Room) -> None:
    dataset = dataset_of(grey_ramp())
    dataset.ImagerPixelSpacing, dataset.DistanceSourceToDetector = ["1e-9", "1e-9"], 950.0
    with pytest.raises(ImageUnreadable, match=r"is 1e-09 and 1e-09 mm \(0.05 to 2\); correct the header"):
        room.service.take(file_of(dataset), "CARM")
    room.open_case(nominal_pixel_mm=0.2, nominal_source_to_detector_mm=None)
    room.service.take(file_of(dataset), "CARM")
    header = decode(FrameHeader, room.frames.get(timeout=PATIENCE_S).attachment)
    assert header.nominal_pixel_mm == 0.2
    assert [note.partition(" (")[0] for note in header.notes] == ["ImagerPixelSpacing"]


def test_a_broken_ring_file_is_said_in_the_status_and_the_next_case_mends_it(room: Room) -> None:
    context = CaseContext(case_id="case-2", revision=1, ring_json='{"schema": "distalock/ring/1"}')
    room.bus.retained_publisher(KEYS.case_context).put(encode(context))
    assert "correct the ring's file" in room.wait_for("degraded").detail
    room.open_case()
    room.service.take(small_dicom(), "CARM")
    assert room.calibration().case_id == "case-1"


def test_images_that_come_while_the_open_case_cannot_be_used_belong_to_no_case(room: Room) -> None:
    room.open_case()
    context = CaseContext(case_id="case-2", revision=1, ring_json='{"schema": "distalock/ring/1"}')
    room.bus.retained_publisher(KEYS.case_context).put(encode(context))
    room.wait_for("degraded")
    room.service.take(small_dicom(), "CARM")
    header = decode(FrameHeader, room.frames.get(timeout=PATIENCE_S).attachment)
    assert (header.case_id, header.case_revision) == (None, 0)
    assert [one.skip and one.skip.code for one in stored(room)] == ["no_case"]
    assert room.calibrations.empty()
    assert asked_for_quality(room, header.sha256).code == "case_not_open"


def test_images_of_the_case_before_wait_while_the_open_case_cannot_be_used(tmp_path: Path) -> None:
    memory = HeldMemory(tmp_path / "positions")
    with room_of(ImageStore(tmp_path), tmp_path / "positions", memory, run_interval_s=0.0) as room:
        room.open_case()
        room.service.take(small_dicom(), "CARM")
        assert memory.begun.wait(PATIENCE_S)
        room.service.take(small_dicom(), "CARM")
        room.bus.retained_publisher(KEYS.case_context).put(b"no case")
        room.wait_for("degraded")
        memory.released.set()
        assert room.calibration().image.sequence == 1
        assert [one.calibration for one in stored(room)] == ["done", "pending"]
        room.open_case()
        assert room.calibration().image.sequence == 2


def angled(scene: Scene) -> bytes:
    """A rendered image as DICOM at 30 and 10 degrees."""
    dataset = dataset_of(render(scene, default_ring()).pixels.astype(np.uint16))
    dataset.PositionerPrimaryAngle, dataset.PositionerSecondaryAngle = 30.0, 10.0
    return file_of(dataset)


def test_a_ring_that_moved_since_the_c_arm_stood_there_is_noticed_after_a_restart(tmp_path: Path) -> None:
    scene = Scene(seed=60, others=4)
    store, positions = ImageStore(tmp_path / "images"), tmp_path / "positions"
    with room_of(store, positions) as first:
        first.open_case()
        first.service.take(angled(scene), "CARM")
        assert first.calibration().verdict == "accepted"
    with room_of(store, positions) as second:
        second.open_case()
        for moved, said in (
            (replace(scene, seed=61), ""),
            (replace(scene, seed=62, turn_deg=32.0), "check that it is"),
        ):
            second.service.take(angled(moved), "CARM")
            assert second.calibration().verdict == "accepted"
            if said:
                assert said in second.wait_for("ready").detail
        assert second.statuses.empty()


def asked_for_quality(room: Room, *image_sha256: str) -> QaReply:
    request = QaRequest(case_id="case-1", image_sha256=image_sha256)
    return decode(QaReply, room.bus.query(KEYS.qa_request, encode(request), PATIENCE_S).payload)


def test_a_quality_report_is_made_from_kept_images_and_compared_with_the_last(room: Room) -> None:
    room.open_case()
    rendered = render(Scene(seed=22, turn_deg=40.0), default_ring())
    room.service.take(bytes(cv2.imencode(".png", rendered.pixels.astype(np.uint16))[1]), "file")
    sha256 = room.calibration().image.sha256
    first, second = asked_for_quality(room, sha256), asked_for_quality(room, sha256)
    assert first.report is not None
    assert second.report is not None
    assert [i.verdict for i in first.report.images] == ["accepted"]
    assert first.page.startswith("<!doctype html>")
    assert first.report.drift is None
    assert second.report.drift is not None
    assert second.report.drift.source_mm == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_no_quality_report_without_case_or_image(room: Room) -> None:
    assert asked_for_quality(room, "0" * 64).code == "case_not_open"
    room.open_case()
    reply = asked_for_quality(room, "0" * 64)
    assert (reply.code, reply.report) == ("unknown_image", None)
    assert "1 of the 1 images are not kept here (limit 0)" in reply.message


class FullStore(ImageStore):
    """Takes no image while it is full."""

    full = True

    def put(self, content: bytes) -> str:
        if self.full:
            raise OSError(28, "No space left on device")
        return super().put(content)

    def takes_images(self) -> bool:
        return not self.full and super().takes_images()


def test_a_store_that_takes_nothing_degrades_imaging_until_it_takes_an_image(tmp_path: Path) -> None:
    store = FullStore(tmp_path)
    with room_of(store, tmp_path / "positions") as room:
        room.service._runtime.ready()
        with pytest.raises(OSError, match="No space left"):
            room.service.take(small_dicom(), "CARM")
        assert "could not be stored (No space left on device); see to the disk" in room.wait_for("degraded").detail
        store.full = False
        room.service.take(small_dicom(), "CARM")
        room.wait_for("ready")


def test_an_image_that_the_store_did_not_take_at_first_is_as_old_as_its_first_receipt(tmp_path: Path) -> None:
    store, now_s = FullStore(tmp_path), [100.0]
    with room_of(store, tmp_path / "positions", clock=Clock(monotonic_s=lambda: now_s[0])) as room:
        with pytest.raises(OSError, match="No space left"):
            room.service.take(small_dicom(), "CARM")
        now_s[0], store.full = 104.0, False
        room.service.take(small_dicom(), "CARM")
        assert decode(FrameHeader, room.frames.get(timeout=PATIENCE_S).attachment).age_s == 4.0


@pytest.mark.parametrize(("waited_s", "age_s"), [(0.0, 0.0), (3.0, 3.0), (None, None)])
def test_an_image_is_as_old_as_the_time_that_it_has_waited_at_its_source(
    tmp_path: Path, waited_s: float | None, age_s: float | None
) -> None:
    with room_of(ImageStore(tmp_path), tmp_path / "positions", clock=Clock(monotonic_s=lambda: 100.0)) as room:
        room.service.take(small_dicom(), "file", waited_s)
        assert decode(FrameHeader, room.frames.get(timeout=PATIENCE_S).attachment).age_s == age_s


def test_an_image_that_is_sent_again_with_the_patients_name_corrected_is_as_old_as_the_first(tmp_path: Path) -> None:
    now_s = [100.0]
    with room_of(ImageStore(tmp_path), tmp_path / "positions", clock=Clock(monotonic_s=lambda: now_s[0])) as room:
        room.service.take(small_dicom(), "CARM")
        corrected = dcmread(BytesIO(small_dicom()))
        corrected.PatientName = "Corrected^Name"
        now_s[0] = 700.0
        room.service.take(file_of(corrected), "CARM")
        headers = [decode(FrameHeader, room.frames.get(timeout=PATIENCE_S).attachment) for _ in range(2)]
    assert len({one.sha256 for one in headers}) == 2
    assert [one.age_s for one in headers] == [0.0, 600.0]


def test_a_store_that_would_take_an_image_again_is_ready_before_one_comes(tmp_path: Path) -> None:
    store = FullStore(tmp_path)
    with room_of(store, tmp_path / "positions") as room:
        room.service._runtime.ready()
        with pytest.raises(OSError, match="No space left"):
            room.service.take(small_dicom(), "CARM")
        room.wait_for("degraded")
        store.full = False
        room.wait_for("ready")


class FailingIndex:
    """An image store's index whose disk fails until it is mended; everything else is the index's own."""

    def __init__(self, index: ImageIndex) -> None:
        self._index = index
        self.mended = threading.Event()

    def __getattr__(self, name: str) -> object:
        return getattr(self._index, name)

    def is_pending(self, sequence: int) -> bool:
        if not self.mended.is_set():
            raise OSError(5, "Input/output error")
        return self._index.is_pending(sequence)


def test_an_image_that_the_disk_held_up_is_calibrated_when_the_disk_is_back(tmp_path: Path) -> None:
    store = ImageStore(tmp_path)
    failing = FailingIndex(store.index)
    store.index = failing  # type: ignore[assignment]
    with room_of(store, tmp_path / "positions") as room:
        room.open_case()
        room.service.take(small_dicom(), "CARM")
        assert room.wait_for("degraded").detail == "Input/output error; see to the disk of the image store"
        failing.mended.set()
        assert room.calibration().image.sequence == 1
        room.wait_for("ready")

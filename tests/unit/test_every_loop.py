"""An exception is injected into every loop that there is. A thread that is new here and has no injection fails."""

import ast
import os
import queue
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NoReturn

import pytest
import structlog
from fastapi import FastAPI

from services.imaging.devices.association_gate import GatedServer
from services.imaging.devices.c_arm_memory import CArmMemory
from services.imaging.devices.dicom_receiver import DicomSource, Endpoint
from services.imaging.devices.folder_source import FolderSource
from services.imaging.devices.image_store import ImageStore
from services.imaging.devices.position_store import PositionStore
from services.imaging.devices.video_frames import newest_frames
from services.imaging.devices.video_source import VideoSettings, VideoSource
from services.registration.service import RegistrationService
from services.registration.settings import RegistrationSettings
from services.registration.state import RegistrationState
from services.robot.core.stop_result import SentStop
from services.robot.devices.gcs.controller import GcsController
from services.ui_api.front.application import running_application
from services.ui_api.front.port import listening_socket
from services.ui_api.front_link import FrontLink
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.leases import Leases
from services.ui_api.handlers.stop import StopOutcome
from services.ui_api.handlers.stop_sender import StopSender
from services.ui_api.link_messages import StopBegun, StopRecorded
from services.ui_api.server import serving
from shared.bus.declarations import pump
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.refusal_watch import RefusalWatch
from shared.bus.workers import Worker
from shared.messages.robot import MotionState
from shared.runtime.impairments import watched
from shared.runtime.lifecycle import Runtime, open_service
from shared.runtime.log_lines import LineWriter
from shared.runtime.presence import beating
from shared.runtime.settings import ServiceSettings
from shared.signals import PARENT_PIPE, set_by_signals
from shared.threads import faults_go_to
from tests.unit.services.imaging.devices.fake_video import FakeCamera
from tests.unit.services.imaging.devices.test_video_source import film
from tests.unit.services.imaging.test_service import room_of
from tests.unit.services.robot.fake_gcs import FakeGcs
from tests.unit.services.robot.room import HEXAPOD
from tests.unit.services.robot.room import Room as RobotRoom
from tests.unit.services.ui_api.front.rig import front
from tests.unit.services.ui_api.room import open_room

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0
KEYS = Keys("or1")
LOG: structlog.stdlib.BoundLogger = structlog.stdlib.get_logger("test")
# Everything else that begins work beside the caller's, and who sees what it raises.
SEEN_OTHERWISE = {
    ("shared/threads.py", "Thread"): "the supervisor itself",
    ("shared/bus/memory_declarations.py", "add_done_callback"): "hands an answer over and does nothing else",
    ("shared/bus/zenoh_bus.py", "add_done_callback"): "sends an answer; who asked hears nothing when that fails",
    ("shared/two_cores.py", "ThreadPoolExecutor"): "the caller waits for the result and gets the exception",
    ("shared/runtime/lifecycle.py", "Timer"): "its work is supervised; it ends the process in any case",
    ("services/ui_api/front/relay.py", "ensure_future"): "the connection waits for both, and gets the exception",
    ("services/ui_api/front/server.py", "create_task"): "in a group: what it raises ends the front's loop with a fault",
    ("services/ui_api/front/server.py", "ensure_future"): "reports what it raises",
    ("services/ui_api/front/server.py", "add_done_callback"): "forgets the task and nothing else",
    ("services/ui_api/front/stops.py", "add_done_callback"): "hands a message over; the stop was sent before",
    ("services/ui_api/front_link.py", "add_done_callback"): "sends a message and nothing else",
    ("services/ui_api/handed_server.py", "create_task"): "reports what it raises",
    ("services/ui_api/handed_server.py", "add_done_callback"): "forgets the task and nothing else",
    ("services/ui_api/handlers/commands.py", "ThreadPoolExecutor"): "its work is supervised",
    ("services/ui_api/handlers/computations.py", "ThreadPoolExecutor"): "its work is supervised",
    ("services/ui_api/handlers/commands.py", "add_done_callback"): "counts and nothing else",
    ("services/ui_api/handlers/readiness.py", "ThreadPoolExecutor"): "readyz looks at every result",
    ("services/ui_api/inner/protocol.py", "create_task"): "an exchange reports what it raises",
    ("services/ui_api/inner/protocol.py", "add_done_callback"): "forgets the task and nothing else",
    ("services/ui_api/routes/audience.py", "create_task"): "reports what it raises",
    ("services/ui_api/routes/live.py", "create_task"): "the viewer's own task; it ends with the viewer",
    ("services/ui_api/routes/live.py", "add_done_callback"): "sets an event and nothing else",
    ("simulation/render/primary.py", "ThreadPoolExecutor"): "the caller waits for the result and gets the exception",
}
BEGINS_WORK = {
    "Thread",
    "Timer",
    "ThreadPoolExecutor",
    "ProcessPoolExecutor",
    "Process",
    "create_task",
    "ensure_future",
    "run_in_executor",
    "add_done_callback",
}


class Injected(Exception):
    """What no loop is prepared for."""


def inject(*_: object, **__: object) -> NoReturn:
    raise Injected("injected")


class Broken:
    """A queue, or whatever else a loop waits for."""

    take = link_up = write = monotonic_s = sendall = note_stop_begun = inject

    def close(self) -> None:
        """As any."""


class Listener:
    """Keeps faults; what it hears of lesser errors raises, so that they leave the loop in which they are reported."""

    def __init__(self) -> None:
        self.faults: queue.Queue[str] = queue.Queue()
        self.first: Callable[[str], None] = lambda _: None

    def fail(self, message: str) -> None:
        self.first(message)
        self.faults.put(message)

    def note_error(self, place: str, error: BaseException) -> None:
        inject(place, error)


class Rig:
    """What an injection stands on."""

    def __init__(self, stack: ExitStack, listener: Listener, tmp_path: Path) -> None:
        self.stack, self.listener, self.tmp_path = stack, listener, tmp_path

    def robot(self) -> RobotRoom:
        """A robot that moves, and that a fault stops as its service's composition has it stopped."""
        room = RobotRoom()
        self.listener.first = room.service._drive.fail
        self.stack.enter_context(room.service)
        room.begin_move()
        return room

    def service(self) -> tuple[MemoryRouter, Runtime]:
        router = MemoryRouter()
        _, runtime = self.stack.enter_context(open_service("imaging", ServiceSettings(), lambda _: router.open()))
        return router, runtime


def break_heartbeat(rig: Rig) -> str:
    class Heartless(MemoryRouter):
        deliver = inject

    rig.stack.enter_context(beating(Heartless().open(), KEYS, "robot", "boot-1", 20.0))
    return "heartbeat robot"


def break_impairments(rig: Rig) -> str:
    class Unimpaired:
        status = type("Status", (), {"impair": inject})()

        def forget_errors(self) -> None:
            """Never reached."""

    rig.stack.enter_context(watched(Unimpaired(), ServiceSettings()))
    return "impairments"


def break_pump(_: Rig) -> str:
    class Channel:
        def __iter__(self) -> Iterator[int]:
            inject()
            yield 1

        def undeclare(self) -> None:
            """As any."""

    pump(Channel(), print, "key")
    return "bus key"


def break_memory_worker(rig: Rig) -> str:
    worker = Worker("key")
    worker.submit(inject)
    rig.stack.callback(worker.close)
    return "memory-bus key"


def break_refusals(rig: Rig) -> str:
    class Log:
        def wait(self, _timeout_s: float) -> None:
            inject()

        def lines(self) -> Iterator[str]:
            return iter(())

    watch = RefusalWatch(Log(), "run-1", print)  # type: ignore[arg-type]
    watch.start()
    rig.stack.callback(watch.close)
    return "refusals"


def break_signals(rig: Rig) -> str:
    stop = threading.Event()
    stop.set = inject  # type: ignore[method-assign]
    rig.stack.enter_context(set_by_signals(stop))
    os.kill(os.getpid(), signal.SIGTERM)
    return "signals"


def break_parent_watch(rig: Rig) -> str:
    reads, writes = os.pipe()
    rig.stack.callback(os.close, reads)
    os.environ[PARENT_PIPE] = str(reads)
    stop = threading.Event()
    stop.set = inject  # type: ignore[method-assign]
    rig.stack.enter_context(set_by_signals(stop))
    os.close(writes)
    return "parent"


def break_log(_: Rig) -> str:
    class Sink:
        def write(self, line: str) -> None:
            raise SystemExit(f"injected into {line}")

    LineWriter(Sink(), lambda count, why: f"{count} {why}").put("line")
    return "log"


def break_drive(rig: Rig) -> str:
    rig.robot().controller.after_read = inject
    return "drive"


def break_stop_confirmation(rig: Rig) -> str:
    rig.robot().service._drive.when_confirmed(SentStop(0, "the line is cut"), inject)
    return "stop-confirmation"


def break_robot_state(rig: Rig) -> str:
    room = rig.robot()
    room.service._publisher = type("Publisher", (), {"put": inject})()
    rig.stack.callback(lambda: setattr(room.service, "_publisher", type("Gone", (), {"put": lambda *_: None})()))
    return "robot-state"


def break_gateway_watch(rig: Rig) -> str:
    rig.robot().service.watch._presence = Broken()  # type: ignore[assignment]
    return "gateway-watch"


def break_reader(rig: Rig) -> str:
    port = FakeGcs()
    line = GcsController(port, HEXAPOD)
    rig.stack.callback(line.close)
    port.read = inject  # type: ignore[method-assign]
    return "controller-reader"


def registration(rig: Rig, change: Callable[[RegistrationService], None]) -> None:
    router = MemoryRouter()
    settings = RegistrationSettings()
    state = RegistrationState("registration-1", settings.kept_images, settings.image_delay_s, lambda: 0.0)
    bus, runtime = rig.stack.enter_context(open_service("registration", settings, lambda _: router.open()))
    service = RegistrationService(bus, runtime, settings, state)
    change(service)
    rig.stack.enter_context(service.running())
    rig.stack.callback(runtime.stop.set)


def break_localise(rig: Rig) -> str:
    registration(rig, lambda service: setattr(service, "_jobs", Broken()))
    return "localise"


def break_epoch(rig: Rig) -> str:
    registration(rig, lambda service: setattr(service._state, "wait_for_another_epoch", inject))
    return "epoch"


def break_guidance(rig: Rig) -> str:
    registration(rig, lambda service: setattr(service._guidance, "_frames", Broken()))
    return "guidance"


def break_calibrate(rig: Rig) -> str:
    room = rig.stack.enter_context(
        room_of(ImageStore(rig.tmp_path), rig.tmp_path, CArmMemory(PositionStore(rig.tmp_path)))
    )
    room.service._calibrator._newest = Broken()  # type: ignore[assignment]
    return "calibrate"


def break_video(rig: Rig) -> str:
    file = film(rig.tmp_path / "film.avi", [0.0] * 12)
    source = VideoSource(VideoSettings(str(file), most_frames=8), LOG)
    rig.stack.enter_context(source.receiving(inject))
    return "video"


def break_video_frames(rig: Rig) -> str:
    class Torn(FakeCamera):
        read = inject

    rig.stack.enter_context(newest_frames(Torn(), threading.Event()))
    return "video frames"


def break_folder(rig: Rig) -> str:
    (rig.tmp_path / "image.png").write_bytes(b"content")
    source = FolderSource(rig.tmp_path, LOG)
    rig.stack.enter_context(source.receiving(inject))
    return "watch folder"


def break_leases(rig: Rig) -> str:
    leases = Leases(Clock(lambda: 0, inject), 0.5, lambda _: None)
    leases.start()
    rig.stack.callback(leases.close)
    return "leases"


def break_lapse(rig: Rig) -> str:
    leases = Leases(Clock(), 0.01, inject)
    leases.grant("operation")
    leases.start()
    rig.stack.callback(leases.close)
    return "lapse"


def break_application_watch(rig: Rig) -> str:
    running = running_application((), inject, module="tests.unit.services.ui_api.front.fake_application")
    application = rig.stack.enter_context(running)
    application.process.kill()
    return "application"


def break_front(rig: Rig) -> str:
    broken = rig.stack.enter_context(front(lambda _: None))
    broken.link.on_recorded = inject
    broken.its_end.sendall(StopRecorded(number=1).line())
    return "front"


def break_application_beat(rig: Rig) -> str:
    rig.stack.enter_context(FrontLink(Broken(), print).beating())  # type: ignore[arg-type]
    return "application beat"


def break_front_link(rig: Rig) -> str:
    ours, its = (rig.stack.enter_context(end) for end in socket.socketpair())
    ours.sendall(StopBegun().line())
    FrontLink(its, print).listen(Broken())  # type: ignore[arg-type]
    return "front link"


def break_live_pictures(rig: Rig) -> str:
    room = rig.stack.enter_context(open_room(rig.tmp_path))
    room.gateway.live._encoder.picture = inject  # type: ignore[method-assign]
    rig.stack.enter_context(room.gateway.live.watching(lambda: None))
    room.imaging.send("one", None)
    return "live pictures"


def break_stop_record(rig: Rig) -> str:
    room = rig.stack.enter_context(open_room(rig.tmp_path))
    room.gateway.stop_recorder._append = inject  # type: ignore[method-assign]
    room.gateway.stop_recorder.put(StopOutcome(confirmed=True, state=MotionState.STOPPED, message=""), "test", "test")
    return "stop record"


def break_stop(_: Rig) -> str:
    StopSender(inject).begin("test")
    return "stop"


def break_inbox(rig: Rig) -> str:
    room = rig.stack.enter_context(open_room(rig.tmp_path))
    room.gateway.inbox._queue.take = inject  # type: ignore[method-assign]
    return "inbox"


def break_catch_up(rig: Rig) -> str:
    room = rig.stack.enter_context(open_room(rig.tmp_path))
    room.gateway.inbox._catch_up._ask_for_images = inject  # type: ignore[method-assign]
    return "catch up"


def break_http(rig: Rig) -> str:
    listening = listening_socket("127.0.0.1", 0)
    listening.close()
    rig.stack.enter_context(serving(FastAPI(), listening, lambda: None))
    return "http"


def break_streams(rig: Rig) -> str:
    listening, (_, taking) = listening_socket("127.0.0.1", 0), socket.socketpair()
    taking.close()
    rig.stack.enter_context(serving(FastAPI(), listening, lambda: None, taking))
    return "streams"


def break_commands(rig: Rig) -> str:
    room = rig.stack.enter_context(open_room(rig.tmp_path))
    room.gateway.commands._bus = type("Bus", (), {"query": inject})()
    room.robot.say(MotionState.STOPPED)
    begun = room.post("/robot/acknowledge-stop").json()
    room.wait_for_status(str(begun["id"]), "unknown")
    return "commands"


def break_computations(rig: Rig) -> str:
    room = rig.stack.enter_context(open_room(rig.tmp_path))
    case_id = room.open_case()
    room.image("image", case_id)
    room.gateway.planning._bus = type("Bus", (), {"query": inject})()
    begun = room.post(f"/cases/{case_id}/operations", {"plan": {"localisation": 1, "hole_ids": ["distal"]}}).json()
    room.log.wait_for(lambda: room.gateway.record.ledger.computations[str(begun["id"])].ended)
    return "computations"


def break_dicom(rig: Rig) -> str:
    def restore(actions: Callable[[GatedServer], None] = GatedServer.service_actions) -> None:
        GatedServer.service_actions = actions  # type: ignore[method-assign, assignment]

    GatedServer.service_actions = inject  # type: ignore[method-assign]
    rig.stack.callback(restore)
    endpoint = Endpoint("127.0.0.1", 0, "DISTALOCK", (), 4)
    rig.stack.enter_context(DicomSource(endpoint, LOG).receiving(lambda *_: None))
    return "DICOM reception"


# By file, and by the name of the thread as the source has it.
INJECTIONS: dict[tuple[str, str], Callable[[Rig], str]] = {
    ("shared/bus/declarations.py", "bus {name}"): break_pump,
    ("shared/bus/refusal_watch.py", "refusals"): break_refusals,
    ("shared/bus/workers.py", "memory-bus {name}"): break_memory_worker,
    ("shared/runtime/impairments.py", "impairments"): break_impairments,
    ("shared/runtime/log_lines.py", "log"): break_log,
    ("shared/runtime/presence.py", "heartbeat {service}"): break_heartbeat,
    ("shared/signals.py", "parent"): break_parent_watch,
    ("shared/signals.py", "signals"): break_signals,
    ("services/imaging/devices/dicom_receiver.py", "DICOM reception"): break_dicom,
    ("services/imaging/devices/folder_source.py", "watch folder"): break_folder,
    ("services/imaging/devices/video_frames.py", "video frames"): break_video_frames,
    ("services/imaging/devices/video_source.py", "video"): break_video,
    ("services/imaging/service/calibrator.py", "calibrate"): break_calibrate,
    ("services/registration/live.py", "guidance"): break_guidance,
    ("services/registration/service.py", "epoch"): break_epoch,
    ("services/registration/service.py", "localise"): break_localise,
    ("services/robot/devices/serial_line.py", "controller-reader"): break_reader,
    ("services/robot/drive/drive.py", "drive"): break_drive,
    ("services/robot/drive/stop_confirmation.py", "stop-confirmation"): break_stop_confirmation,
    ("services/robot/gateway_monitor.py", "gateway-watch"): break_gateway_watch,
    ("services/robot/service.py", "robot-state"): break_robot_state,
    ("services/ui_api/front/application.py", "application"): break_application_watch,
    ("services/ui_api/front/server.py", "front"): break_front,
    ("services/ui_api/front_link.py", "application beat"): break_application_beat,
    ("services/ui_api/front_link.py", "front link"): break_front_link,
    ("services/ui_api/handlers/catch_up.py", "catch up"): break_catch_up,
    ("services/ui_api/handlers/commands.py", "commands"): break_commands,
    ("services/ui_api/handlers/computations.py", "computations"): break_computations,
    ("services/ui_api/handlers/inbox.py", "inbox"): break_inbox,
    ("services/ui_api/handlers/leases.py", "lapse"): break_lapse,
    ("services/ui_api/handlers/leases.py", "leases"): break_leases,
    ("services/ui_api/handlers/live.py", "live pictures"): break_live_pictures,
    ("services/ui_api/handlers/stop_recorder.py", "stop record"): break_stop_record,
    ("services/ui_api/handlers/stop_sender.py", "stop"): break_stop,
    ("services/ui_api/server.py", "http"): break_http,
    ("services/ui_api/server.py", "streams"): break_streams,
}
# It ends the process with code 1 whatever happens in it: see `lifecycle`.
ENDS_ANYWAY = {("shared/runtime/lifecycle.py", "leaving")}
MOVES = ("drive", "stop-confirmation", "robot-state", "gateway-watch")


def calls(*folders: str) -> Iterator[tuple[str, ast.Call]]:
    for folder in folders:
        for file in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call):
                    yield str(file.relative_to(ROOT)), node


def name_of(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def thread_name(call: ast.Call) -> str:
    """The first argument as it stands in the source, the last part of what is put in between braces."""
    first = call.args[0]
    if isinstance(first, ast.Constant):
        return str(first.value)
    assert isinstance(first, ast.JoinedStr), ast.dump(first)
    parts = [
        str(part.value) if isinstance(part, ast.Constant) else "{" + ast.unparse(getattr(part, "value", part)) + "}"
        for part in first.values
    ]
    return "".join(parts)


def test_every_supervised_thread_has_an_injection() -> None:
    found = {
        (file, thread_name(call))
        for file, call in calls("services", "shared")
        if name_of(call) in ("supervised_thread", "supervised") and file != "shared/threads.py"
    }
    assert found == set(INJECTIONS) | ENDS_ANYWAY


def test_nothing_else_begins_work_beside_the_callers() -> None:
    found = {
        (file, name_of(call))
        for file, call in calls("services", "shared", "simulation", "distalock")
        if name_of(call) in BEGINS_WORK
    }
    assert found == set(SEEN_OTHERWISE)


@pytest.mark.requirement("ROB-16")
@pytest.mark.parametrize("place", sorted(INJECTIONS), ids=lambda place: place[1])
def test_an_exception_in_any_loop_is_a_fault_and_stops_the_robot(place: tuple[str, str], tmp_path: Path) -> None:
    listener = Listener()
    with faults_go_to(listener), ExitStack() as stack:
        rig = Rig(stack, listener, tmp_path)
        name = INJECTIONS[place](rig)
        message = ""
        while not message.startswith(f"thread '{name}' ended with "):
            message = listener.faults.get(timeout=PATIENCE_S)
        assert "injected" in message or name in ("http", "streams")
        if name in MOVES:
            drive = listener.first.__self__  # type: ignore[attr-defined]
            assert drive.status.state is MotionState.FAULT
            assert "the robot service failed" in drive.status.detail

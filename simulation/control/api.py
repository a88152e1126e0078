"""The virtual operating room's own control API: what people's hands do, and the truth. Not part of the product."""

import time

from fastapi import FastAPI, Response

from simulation.control.fault_models import ControllerFault, FaultBody, FaultsBody, faults_body, with_fault
from simulation.control.models import (
    CArmBody,
    CArmTurnBody,
    DrillBody,
    FluoroscopyBody,
    Health,
    PassageBody,
    PassagesBody,
    RunBody,
    ScenarioBody,
    ShotBody,
    WiresBody,
    c_arm_body,
    passage_body,
    scenario_body,
)
from simulation.control.problems import Problem, add_problem_handlers
from simulation.control.truth_models import ControllerBody, TruthBody, controller_body, truth_body
from simulation.controller.faults import Fault
from simulation.controller.virtual_controller import VirtualController
from simulation.room.faults import NO_ROOM_FAULTS
from simulation.room.foot_pedal import FluoroscopyRun, FootPedal, TakenShot
from simulation.room.operating_room import OperatingRoom
from simulation.scenario.c_arm_angles import CArmAngles


def _shot_body(shot: TakenShot) -> ShotBody:
    return ShotBody(
        number=shot.number,
        taken_at=shot.taken_at,
        sop_instance_uid=shot.dicom.sop_instance_uid,
        sha256=shot.dicom.file_sha256,
        pixel_sha256=shot.dicom.pixel_sha256,
        c_arm=c_arm_body(shot.angles),
        delivered_to=None if shot.delivered_to is None else str(shot.delivered_to),
    )


def control_app(room: OperatingRoom, pedal: FootPedal, controller: VirtualController) -> FastAPI:
    """The control API of one room; `controller` is there only to put faults into it."""
    app = FastAPI(title="distalock virtual operating room", version="1", docs_url="/docs", redoc_url=None)
    add_problem_handlers(app)
    _add_looking(app, room, pedal)
    _add_controller(app, controller)
    _add_imaging(app, room, pedal)
    _add_tools(app, room)
    _add_faults(app, room, controller)
    return app


def _add_looking(app: FastAPI, room: OperatingRoom, pedal: FootPedal) -> None:
    @app.get("/healthz")
    def healthz() -> Health:
        """Whether the process answers."""
        return Health()

    @app.get("/scenario")
    def scenario() -> ScenarioBody:
        """What people in the room know: the body of `POST /cases`, the holes, the drill; nothing of the truth."""
        return scenario_body(room.scenario)

    @app.get("/truth")
    def truth() -> TruthBody:
        """Where everything really is, and what the last image should show."""
        return truth_body(room, None if pedal.last is None else pedal.last.truth)


def _add_controller(app: FastAPI, controller: VirtualController) -> None:
    @app.get("/controller")
    def hexapod() -> ControllerBody:
        """The hexapod as it really is, on the monotonic clock of this host."""
        return controller_body(controller.snapshot(), time.monotonic())


def _add_imaging(app: FastAPI, room: OperatingRoom, pedal: FootPedal) -> None:
    @app.post("/shots", status_code=201)
    def take_shot() -> ShotBody:
        """Step on the foot pedal: one X-ray image, which is sent by DICOM before the answer comes."""
        return _shot_body(pedal.press())

    @app.post("/fluoroscopy", status_code=201)
    def hold_pedal(body: FluoroscopyBody) -> RunBody:
        """Hold the pedal: a run of images at a rate, the C-arm turning meanwhile."""
        run = FluoroscopyRun(
            body.images, body.images_per_s, body.places, body.about_image_x_deg, body.about_image_y_deg
        )
        held = pedal.hold(run)
        return RunBody(images=body.images, seconds=held.seconds, late=held.late, last=_shot_body(held.last))

    @app.get("/shots/last.dcm", response_class=Response)
    def last_shot() -> Response:
        """The last image as it was sent, a DICOM file."""
        if pedal.last is None:
            raise Problem(404, "no_shot_yet", "no shot was taken so far; POST /shots takes one")
        return Response(pedal.last.dicom.file, media_type="application/dicom")

    @app.get("/c-arm")
    def c_arm() -> CArmBody:
        """The C-arm's angles."""
        return c_arm_body(room.angles)

    @app.put("/c-arm")
    def turn_c_arm(body: CArmBody) -> CArmBody:
        """Turn the C-arm to these angles."""
        return c_arm_body(room.turn_c_arm(CArmAngles(body.orbital_deg, body.angular_deg)))

    @app.post("/c-arm/turn")
    def turn_c_arm_about_image(body: CArmTurnBody) -> CArmBody:
        """Turn the C-arm by some angles about the image's axes, as the product advises."""
        return c_arm_body(room.turn_c_arm_about_image(body.about_image_x_deg, body.about_image_y_deg))


def _add_tools(app: FastAPI, room: OperatingRoom) -> None:
    @app.get("/wires")
    def wires() -> PassagesBody:
        """The K-wires that are in, and how each went."""
        return PassagesBody(items=[passage_body(w) for w in room.wires])

    @app.post("/wires", status_code=201)
    def insert_wires(body: WiresBody | None = None) -> PassagesBody:
        """Push a K-wire through guide holes: through all that the nail has too, unless some are named."""
        named = body.hole_ids if body is not None and body.hole_ids is not None else None
        holes = room.scenario.parts.common_hole_ids if named is None else tuple(named)
        return PassagesBody(items=[passage_body(w) for w in room.insert_wires(holes)])

    @app.delete("/wires", status_code=204)
    def remove_wires() -> None:
        """Pull all K-wires out."""
        room.remove_wires()

    @app.get("/drills")
    def drills() -> PassagesBody:
        """Every drilling so far."""
        return PassagesBody(items=[passage_body(d) for d in room.drills])

    @app.post("/drills", status_code=201)
    def drill(body: DrillBody) -> PassageBody:
        """Drill through a guide hole as the robot holds it now."""
        return passage_body(room.drill(body.hole_id))

    @app.delete("/drills", status_code=204)
    def take_new_bone() -> None:
        """Take a bone of the same shape in which nothing was drilled: the next patient."""
        room.take_new_bone()


def _add_faults(app: FastAPI, room: OperatingRoom, controller: VirtualController) -> None:
    def now() -> FaultsBody:
        return faults_body(room.faults, controller.snapshot().faults)

    @app.get("/faults")
    def faults() -> FaultsBody:
        """The faults that are switched on."""
        return now()

    @app.post("/faults", status_code=201)
    def inject(body: FaultBody) -> FaultsBody:
        """Switch one more fault on, or give it another size."""
        if isinstance(body, ControllerFault):
            controller.inject(body.name)
        else:
            room.set_faults(with_fault(room.faults, body))
        return now()

    @app.delete("/faults/controller/{name}", status_code=204)
    def clear_controller_fault(name: Fault) -> None:
        """Mend one fault of the controller."""
        controller.clear(name)

    @app.delete("/faults", status_code=204)
    def clear_faults() -> None:
        """Mend everything."""
        room.set_faults(NO_ROOM_FAULTS)
        for fault in controller.snapshot().faults:
            controller.clear(fault)

"""Small valid parts, images and results, as the other services would send them."""

import base64
import hashlib

import numpy as np

from services.ui_api.core.event_data import CaseSetup, PartUse
from shared.errors import ReasonCode
from shared.messages.base import ReasonMessage
from shared.messages.drawing import Drawing, ImageDrawing
from shared.messages.guidance import Guidance, GuidanceUncertainty, GuidedHole, MirrorCheck
from shared.messages.imaging import CalibrationMessage, FrameHeader
from shared.messages.qa import QaImage, QaReply, QaReport, QaRequest
from shared.messages.registration import (
    CArmCorrection,
    Localisation,
    LocalisationRecord,
    LocalisedCamera,
    LocalisedGuide,
    LocalisedHole,
    LocalisedImage,
    LocalisedNail,
    Plan,
    PlanRequest,
    PredictedHoleError,
    StandardUncertainty,
    Timing,
    Verification,
    VerificationOf,
    VerifiedGuideHole,
    VerifiedWire,
)
from shared.messages.robot import MotionState, PlatformPoseMessage, RobotState, StopLatch
from shared.parts.hexapod_file import default_hexapod

HEXAPOD_SHA256 = default_hexapod().sha256
ROBOT_EPOCH = "robot-1"
WIDTH_PX, HEIGHT_PX = 8, 6
HOME = PlatformPoseMessage(x_mm=0.0, y_mm=0.0, z_mm=0.0, u_deg=0.0, v_deg=0.0, w_deg=0.0)
IDENTITY = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
INTRINSIC = ((4000.0, 0.0, 512.0), (0.0, 4000.0, 512.0), (0.0, 0.0, 1.0))
OVERLAY_PNG = b"\x89PNG overlay"

_BALLS: list[dict[str, object]] = [
    {"id": str(i), "position_mm": [10.0 * i, float(i * i), 0.0], "diameter_mm": 2.0} for i in range(16)
]


def sha(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()


def ring_file() -> dict[str, object]:
    plates = [{"z_mm": 0.0, "radius_mm": 100.0, "thickness_mm": 3.0}]
    return {"schema": "distalock/ring/1", "units": "mm", "balls": _BALLS, "plates": plates}


def guide_file() -> dict[str, object]:
    holes = [
        {"id": name, "point_mm": [x, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], "diameter_mm": 4.1}
        for name, x in (("proximal", -15.0), ("distal", 15.0))
    ]
    return {"schema": "distalock/guide/1", "units": "mm", "balls": _BALLS, "holes": holes, "body": []}


def nail_file() -> dict[str, object]:
    holes = [
        {"id": name, "position_mm": [x, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], "diameter_mm": 5.3}
        for name, x in (("proximal", -15.0), ("distal", 15.0))
    ]
    return {
        "schema": "distalock/nail/1",
        "units": "mm",
        "material": "Ti6Al4V",
        "diameter_mm": 11.0,
        "cannulation_diameter_mm": 4.5,
        "tip_x_mm": 35.0,
        "holes": holes,
    }


def case_body(**changes: object) -> dict[str, object]:
    body: dict[str, object] = {
        "side": "left",
        "bone": "femur",
        "mount": "bone",
        "nail": nail_file(),
        "guide": guide_file(),
        "ring": ring_file(),
        "head_extension_mm": 60.0,
    }
    return body | changes


def case_setup() -> CaseSetup:
    holes = ("proximal", "distal")
    return CaseSetup(
        "left",
        "femur",
        "bone",
        60.0,
        ring=PartUse("ring", sha("ring")),
        guide=PartUse("guide", sha("guide"), holes),
        nail=PartUse("nail", sha("nail"), holes),
        hexapod=PartUse("hexapod", sha("hexapod")),
    )


def frame_header(name: str, case_id: str | None, revision: int = 1, sequence: int = 1) -> FrameHeader:
    return FrameHeader(
        sha256=sha(name),
        sop_instance_uid=f"1.2.{sequence}",
        sequence=sequence,
        boot_epoch="imaging-1",
        received_at_ns=1_000 + sequence * 10**9,
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        bits_stored=16,
        case_id=case_id,
        case_revision=revision,
        manufacturer="distalock",
        model_name="virtual C-arm (simulation)",
        nominal_source_to_detector_mm=1000.0,
        nominal_pixel_mm=0.235,
        store_id="store-1",
    )


def pixels() -> bytes:
    return np.linspace(0.0, 1.0, WIDTH_PX * HEIGHT_PX, dtype="<f4").tobytes()


def localisation(image_sha256: str, *reasons: ReasonCode) -> Localisation:
    uncertainty = StandardUncertainty(entry_mm=0.03, axis_deg=0.09)
    hole = LocalisedHole(
        id="distal",
        entry_point_guide_mm=(15.0, 0.0, 40.0),
        axis_guide=(0.0, 0.0, 1.0),
        tilt_to_ray_deg=2.1,
        chance_to_pass=0.999,
        standard_uncertainty=uncertainty,
    )
    return Localisation(
        verdict="rejected" if reasons else "accepted",
        reasons=tuple(ReasonMessage(code=code, message="measured, limit, remedy") for code in reasons),
        method="model",
        image=LocalisedImage(sha256=image_sha256, mirrored=False),
        camera=LocalisedCamera(
            intrinsic_matrix_px=INTRINSIC,
            camera_from_ring=IDENTITY,
            balls_found=104,
            balls_expected=120,
            distortion_residual_px=0.04,
            reprojection_rms_px=0.05,
        ),
        guide=LocalisedGuide(camera_from_guide=IDENTITY, balls_found=21, balls_expected=28, reprojection_rms_px=0.06),
        nail=LocalisedNail(camera_from_nail=IDENTITY, mirror_margin=410.0),
        guide_from_nail=IDENTITY,
        holes=(hole, hole.model_copy(update={"id": "proximal"})),
        c_arm_correction_deg=CArmCorrection(about_image_x=-1.2, about_image_y=0.4),
        timing_ms=Timing(total=640.0),
    )


def calibration(header: FrameHeader) -> CalibrationMessage:
    """Rejected, which is as much a calibration."""
    return CalibrationMessage(
        image=header.reference(),
        case_id=header.case_id,
        case_revision=header.case_revision,
        ring_sha256=sha("ring"),
        software_version="0.1.0",
        verdict="rejected",
        reasons=(),
        values=None,
        elapsed_ms=1.0,
    )


def guidance(header: FrameHeader, about_image_x_deg: float) -> Guidance:
    return Guidance(
        verdict="accepted",
        reasons=(),
        origin="followed",
        image=header.reference(),
        case_id=header.case_id,
        case_revision=header.case_revision,
        holes=(GuidedHole(id="distal", tilt_to_ray_deg=1.5, about_image_x=about_image_x_deg, about_image_y=0.0),),
        c_arm_correction_deg=CArmCorrection(about_image_x=about_image_x_deg, about_image_y=0.0),
        positioner_turn_deg=None,
        standard_uncertainty_deg=GuidanceUncertainty(about_image_x=0.2, about_image_y=0.2),
        mirror_check=MirrorCheck(log_likelihood_ratio=90.0, frames_ago=3),
        skipped=0,
        elapsed_ms=60.0,
        image_age_s=7.5,
    )


def localisation_record(header: FrameHeader, epoch: str, *reasons: ReasonCode) -> LocalisationRecord:
    assert header.case_id is not None
    return LocalisationRecord(
        localisation=localisation(header.sha256, *reasons),
        image=header.reference(),
        case_id=header.case_id,
        case_revision=header.case_revision,
        registration_epoch=epoch,
        robot_boot_epoch=ROBOT_EPOCH,
        robot_pose=HOME,
        ring_sha256=sha("ring"),
        guide_sha256=sha("guide"),
        nail_sha256=sha("nail"),
        software_version="0.1.0",
        overlay_png_base64=base64.b64encode(OVERLAY_PNG).decode(),
        drawing=None if ReasonCode.RING_NOT_FOUND in reasons else drawing(header.sha256),
    )


def drawing(image_sha256: str) -> ImageDrawing:
    empty = Drawing(ring_balls=(), guide_balls=(), nail_edges_px=(), holes=(), drill_paths=(), mounting_screws=())
    return ImageDrawing(
        image_sha256=image_sha256,
        width_px=8,
        height_px=8,
        mirrored=False,
        mm_per_px_at_detector=0.3,
        raw=empty,
        corrected=empty,
    )


def plan(request: PlanRequest, epoch: str, robot_boot_epoch: str = ROBOT_EPOCH) -> Plan:
    uncertainty = StandardUncertainty(entry_mm=0.1, axis_deg=0.2)
    predicted = tuple(
        PredictedHoleError(id=h, offset_mm=0.0, angle_deg=0.0, standard_uncertainty=uncertainty, chance_to_pass=0.99)
        for h in request.hole_ids
    )
    return Plan(
        case_id=request.case_id,
        case_revision=1,
        image_sha256=request.image_sha256,
        registration_epoch=epoch,
        robot_boot_epoch=robot_boot_epoch,
        hexapod_sha256=HEXAPOD_SHA256,
        hole_ids=request.hole_ids,
        head_extension_mm=60.0,
        guide_from_target_guide=IDENTITY,
        start_pose=HOME,
        target_pose=HOME.model_copy(update={"x_mm": 2.0}),
        pivot_mm=(0.0, 0.0, 0.0),
        target_leg_lengths_mm=(45.0, 45.0, 45.0, 45.0, 45.0, 45.0),
        travel_mm=2.0,
        travel_deg=0.0,
        axial_shift_mm=0.0,
        predicted=predicted,
    )


def verification(images: tuple[str, ...], of: VerificationOf = "wires", chance_to_pass: float = 0.999) -> Verification:
    wire = VerifiedWire(
        id="distal",
        entry_offset_mm=0.2,
        exit_offset_mm=0.3,
        angle_deg=0.4,
        standard_uncertainty=StandardUncertainty(entry_mm=0.05, axis_deg=0.1),
        chance_to_pass=chance_to_pass,
    )
    if of == "guide":
        hole = VerifiedGuideHole(**dict(wire))
        return Verification(verdict="accepted", reasons=(), images=images, wires=(), guide_holes=(hole,), of=of)
    return Verification(verdict="accepted", reasons=(), images=images, wires=(wire,))


def robot_state(sequence: int, state: MotionState = MotionState.LOCKED, **changes: object) -> RobotState:
    values: dict[str, object] = {
        "boot_epoch": ROBOT_EPOCH,
        "sequence": sequence,
        "sent_at_ns": sequence * 20_000_000,
        "clock_s": sequence * 0.02,
        "state": state,
        "stop": StopLatch.CLEAR,
        "locked": state is MotionState.LOCKED,
        "referenced": True,
        "pose": HOME,
        "leg_lengths_mm": None,
        "pivot_mm": (0.0, 0.0, 0.0),
        "hexapod_sha256": HEXAPOD_SHA256,
        "controller_identity": "(c) distalock, virtual hexapod (simulation), 1, 0.1.0",
    }
    return RobotState.model_validate(values | changes)


def qa_reply(request: QaRequest) -> QaReply:
    """Imaging's report on these images; none when there is only one."""
    if len(request.image_sha256) < 2:
        return QaReply(code="case_not_open", message="case is not open here; open it")
    images = tuple(QaImage(name=sha256[:12], verdict="accepted") for sha256 in request.image_sha256)
    report = QaReport(
        made_at="2026-01-02T03:04:05+00:00",
        software_version="1",
        ring_sha256="0" * 64,
        verdict="good",
        findings=(),
        images=images,
        balls=(),
        mean_source_mm=(1.0, 2.0, -970.0),
        distortion_px=(),
        drift=None,
    )
    return QaReply(report=report, page="<!doctype html><title>distalock qa</title>")

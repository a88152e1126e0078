"""Faults as the control API takes them, one kind at a time."""

from dataclasses import replace
from typing import Annotated, Literal, TypeAlias, assert_never

from pydantic import Field

from simulation.control.models import Body
from simulation.controller.faults import Fault
from simulation.room.faults import RoomFaults

Shift = Annotated[float, Field(allow_inf_nan=False, ge=-50.0, le=50.0)]


class LowDose(Body):
    """Fewer quanta in every shot."""

    kind: Literal["low_dose"]
    dose_factor: Annotated[float, Field(gt=0.0, le=1.0)] = 0.05


class MotionBlur(Body):
    """Somebody moves during every exposure."""

    kind: Literal["motion_blur"]
    length_px: Annotated[float, Field(gt=0.0, le=60.0)] = 12.0


class Saturation(Body):
    """The display is set too bright."""

    kind: Literal["saturation"]
    overexposure: Annotated[float, Field(ge=1.0, le=100.0)] = 6.0


class RemoveNail(Body):
    """There is no nail in the bone."""

    kind: Literal["remove_nail"]


class RemoveGuide(Body):
    """Somebody took the guide off the robot's head."""

    kind: Literal["remove_guide"]


class RingShift(Body):
    """The ring slipped along the detector's columns."""

    kind: Literal["ring_shift"]
    shift_mm: Shift = 5.0


class MountShift(Body):
    """The robot's mount slipped on the bone, along its base's axes."""

    kind: Literal["mount_shift"]
    shift_mm: tuple[Shift, Shift, Shift]


class ControllerFault(Body):
    """A fault of the hexapod's controller."""

    kind: Literal["controller"]
    name: Fault


RoomFault: TypeAlias = LowDose | MotionBlur | Saturation | RemoveNail | RemoveGuide | RingShift | MountShift
FaultBody: TypeAlias = Annotated[RoomFault | ControllerFault, Field(discriminator="kind")]


class FaultsBody(Body):
    """The faults that are switched on."""

    dose_factor: float
    motion_blur_px: float
    overexposure: float
    nail_present: bool
    guide_present: bool
    ring_shift_mm: float
    mount_shift_mm: tuple[float, float, float]
    controller: list[Fault]


def with_fault(faults: RoomFaults, fault: RoomFault) -> RoomFaults:
    """Switch one more fault on."""
    match fault:
        case LowDose():
            return replace(faults, image=replace(faults.image, dose_factor=fault.dose_factor))
        case MotionBlur():
            return replace(faults, image=replace(faults.image, motion_blur_px=fault.length_px))
        case Saturation():
            return replace(faults, image=replace(faults.image, overexposure=fault.overexposure))
        case RemoveNail():
            return replace(faults, nail_present=False)
        case RemoveGuide():
            return replace(faults, guide_present=False)
        case RingShift():
            return replace(faults, ring_shift_mm=fault.shift_mm)
        case MountShift():
            return replace(faults, mount_shift_mm=fault.shift_mm)
        case _:
            assert_never(fault)


def faults_body(faults: RoomFaults, controller: frozenset[Fault]) -> FaultsBody:
    """Describe the faults in the room and in the controller."""
    return FaultsBody(
        dose_factor=faults.image.dose_factor,
        motion_blur_px=faults.image.motion_blur_px,
        overexposure=faults.image.overexposure,
        nail_present=faults.nail_present,
        guide_present=faults.guide_present,
        ring_shift_mm=faults.ring_shift_mm,
        mount_shift_mm=faults.mount_shift_mm,
        controller=sorted(controller),
    )

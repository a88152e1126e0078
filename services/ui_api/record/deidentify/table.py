"""What becomes of each attribute of an image and of each field of the record; docs/record.md prints it.

Lists name what is kept or replaced. Everything else is removed, also what nobody thought of: that is more than the
Basic Profile asks for, which lists what to remove.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class Action(StrEnum):
    """What is done. The letters are those of table E.1-1."""

    KEEP = "K: kept"
    EMPTY = "Z: empty"
    REPLACE_UID = "U: replaced by a UID of its own, alike everywhere in one export"
    REMOVE = "X: removed"
    PERSON = "D: replaced by person-1, person-2, ..., alike everywhere in one export"
    PSEUDONYM = "D: replaced by a random name, alike everywhere in one export"
    ELAPSED = "D: replaced by the time since the case was opened"


@dataclass(frozen=True, slots=True)
class Rule:
    """What becomes of some attributes or fields, and why."""

    action: Action
    names: tuple[str, ...]
    why: str


# Attributes by their keyword in PS3.6.
DICOM_RULES: Final = (
    Rule(
        Action.KEEP,
        (
            "SOPClassUID",
            "SpecificCharacterSet",
            "ImageType",
            "Modality",
            "InstanceNumber",
            "AcquisitionNumber",
            "SeriesNumber",
            "BodyPartExamined",
            "Laterality",
            "ImageLaterality",
            "BurnedInAnnotation",
        ),
        "which kind of object, and its place among the others",
    ),
    Rule(
        Action.KEEP,
        (
            "Manufacturer",
            "ManufacturerModelName",
            "KVP",
            "ExposureTime",
            "XRayTubeCurrent",
            "Exposure",
            "RadiationSetting",
            "FocalSpots",
            "ImagerPixelSpacing",
            "PixelSpacing",
            "DistanceSourceToDetector",
            "DistanceSourceToPatient",
            "EstimatedRadiographicMagnificationFactor",
            "FieldOfViewShape",
            "FieldOfViewDimensions",
            "PositionerMotion",
            "PositionerType",
            "PositionerPrimaryAngle",
            "PositionerSecondaryAngle",
        ),
        "how the image was made: every measurement depends on it",
    ),
    Rule(
        Action.KEEP,
        (
            "SamplesPerPixel",
            "PhotometricInterpretation",
            "PlanarConfiguration",
            "NumberOfFrames",
            "FrameIncrementPointer",
            "FrameTime",
            "Rows",
            "Columns",
            "BitsAllocated",
            "BitsStored",
            "HighBit",
            "PixelRepresentation",
            "PixelIntensityRelationship",
            "PixelIntensityRelationshipSign",
            "RescaleIntercept",
            "RescaleSlope",
            "RescaleType",
            "WindowCenter",
            "WindowWidth",
            "PresentationLUTShape",
            "ModalityLUTSequence",
            "LUTDescriptor",
            "ModalityLUTType",
            "LUTData",
            "LossyImageCompression",
            "LossyImageCompressionRatio",
            "LossyImageCompressionMethod",
            "PixelData",
        ),
        "the pixels, and how to read them",
    ),
    Rule(
        Action.REPLACE_UID,
        ("SOPInstanceUID", "StudyInstanceUID", "SeriesInstanceUID", "FrameOfReferenceUID"),
        "objects still belong together, and lead nowhere outside",
    ),
    Rule(
        Action.EMPTY,
        (
            "PatientName",
            "PatientID",
            "PatientBirthDate",
            "PatientSex",
            "StudyDate",
            "StudyTime",
            "StudyID",
            "AccessionNumber",
            "ReferringPhysicianName",
        ),
        "identify the patient; the object definition asks for them, so they stay without a value",
    ),
    Rule(
        Action.REMOVE,
        ("every other attribute, all private ones, overlays, unused bits of unsigned pixels",),
        "among them institution, station, device serial number, operators, dates and times, descriptions, comments",
    ),
)

# Fields of events, and keys of JSON documents, at any depth.
RECORD_RULES: Final = (
    Rule(Action.KEEP, ("any number, true, false, null",), "measurements and settings"),
    Rule(
        Action.KEEP,
        (
            "schema",
            "kind",
            "verdict",
            "code",
            "reason_codes",
            "step",
            "status",
            "state",
            "stop",
            "outcome",
            "verb",
            "method",
            "service",
            "side",
            "bone",
            "mount",
            "id",
            "hole_ids",
            "units",
            "material",
            "pixel_format",
            "manufacturer",
            "model_name",
            "version",
            "software_version",
            "authenticated_by",
        ),
        "words from fixed lists, names of holes, makers and versions",
    ),
    Rule(
        Action.PERSON,
        ("who", "approved_by", "approver", "user_name"),
        "people; services that acted stay by their names",
    ),
    Rule(
        Action.PSEUDONYM,
        (
            "case_id",
            "operation_id",
            "command_id",
            "previous_command_id",
            "store_id",
            "boot_epoch",
            "robot_boot_epoch",
            "registration_epoch",
            "any SHA-256",
        ),
        "what names something else still does, and leads nowhere outside",
    ),
    Rule(Action.REPLACE_UID, ("sop_instance_uid",), "as in the image"),
    Rule(
        Action.ELAPSED,
        ("at", "any key that ends in at_ns"),
        "how long things took; nothing where clocks were more than 30 days apart, for that would tell the date",
    ),
    Rule(
        Action.REMOVE,
        ("every other text",),
        "among them reasons in people's own words, messages, names of parts and files, serial numbers, signatures",
    ),
)


def names_of(rules: tuple[Rule, ...], action: Action) -> frozenset[str]:
    """Everything to which an action is done."""
    return frozenset(name for rule in rules if rule.action is action for name in rule.names)


def table_lines(rules: tuple[Rule, ...], first: str) -> list[str]:
    """The rules as a table for the page."""
    rows = [f"| {', '.join(rule.names)} | {rule.action} | {rule.why} |" for rule in rules]
    return [f"| {first} | what is done | why |", "|---|---|---|", *rows]

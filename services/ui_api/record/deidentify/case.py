"""A whole case without what identifies people, ready to be written as a folder."""

import json
from dataclasses import replace
from typing import Final

from pydicom.errors import InvalidDicomError

from services.ui_api.record.deidentify.dicom import BurnedInText, deidentified_dicom
from services.ui_api.record.deidentify.fields import FieldCleaner
from services.ui_api.record.deidentify.pseudonyms import Pseudonyms
from services.ui_api.record.export.content import CaseContent, Document, Image

NOTES: Final = (
    "This case was de-identified after the Basic Application Level Confidentiality Profile of DICOM PS3.15, Annex E.",
    "Only what a list names was kept; names and identifiers were replaced; times count from the opening of the case.",
    "Nobody has looked at the pixels. Look at every image before it is handed on: text may be burned into it.",
    "The hash chain is not here, because it is over what was removed.",
)
_JSON: Final = "application/json"
_PNG: Final = "image/png"


def deidentified(case: CaseContent) -> CaseContent:
    """The case as it may be handed to somebody who must not know whose it is. Pages made for people are left out."""
    pseudonyms = Pseudonyms()
    cleaner = FieldCleaner(pseudonyms, int(str(case.events[0]["at_ns"])))
    documents = (_document(document, cleaner) for document in case.documents)
    return CaseContent(
        pseudonyms.name(case.case_id),
        tuple(cleaner.event(event) for event in case.events),
        tuple(document for document in documents if document is not None),
        tuple(_image(image, pseudonyms) for image in case.images),
        None,
    )


def _document(document: Document, cleaner: FieldCleaner) -> Document | None:
    name = cleaner.pseudonyms.sha256(document.sha256)
    if document.media_type == _PNG:
        return replace(document, sha256=name)
    if document.media_type != _JSON:
        return None
    try:
        content = json.loads(document.content)
    except ValueError:
        return None
    cleaned = json.dumps(cleaner.value("", content), ensure_ascii=False)
    return Document(name, _JSON, cleaned.encode())


def _image(image: Image, pseudonyms: Pseudonyms) -> Image:
    name = pseudonyms.sha256(image.sha256)
    if image.dicom is None:
        return replace(image, sha256=name)
    try:
        return Image(name, deidentified_dicom(image.dicom, pseudonyms))
    except BurnedInText:
        return Image(name, None, "left out: its header states that text is burned into its pixels")
    except (InvalidDicomError, ValueError, AttributeError, KeyError, TypeError) as error:
        return Image(name, None, f"left out: its header cannot be de-identified ({type(error).__name__})")

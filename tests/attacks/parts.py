"""Attacks by part files: one that no administrator has approved, and names that lead out of the catalogue."""

import json
from importlib.resources import files
from typing import Final

import httpx

from distalock.rest_client import bearer
from tests.attacks.attack import Attack, Record
from tests.attacks.site import Site
from tests.attacks.web import PORT, code_of, request_to


def _moved_guide(site: Site) -> str:
    """The guide's file with a hole 3 mm beside its place: nothing in an image shows it."""
    guide = json.loads((files("shared.parts") / "catalogue" / "guide-28.json").read_text())
    guide["holes"][0]["point_mm"][0] += 3.0
    return code_of(
        httpx.patch(
            f"{site.api}/cases/{site.case.id}",
            json={"guide": guide},
            headers={"If-Match": site.case.etag(), **bearer(site.installation.token)},
        )
    )


ATTACKS: Final = (
    Attack(
        "unapproved part file",
        PORT,
        "change the case's guide to a file with a hole 3 mm off",
        "part_not_approved",
        Record("ui_api", "part_not_approved"),
        _moved_guide,
    ),
    Attack(
        "path in a part's name",
        PORT,
        "read `../../../../etc/passwd` as a part",
        "not_found",
        Record("ui_api", "not_found"),
        request_to("GET", "/parts/..%2f..%2f..%2f..%2fetc%2fpasswd"),
    ),
    Attack(
        "path in a set-up",
        PORT,
        "change the nail to one named `../../etc/passwd`",
        "request_invalid",
        Record("ui_api", "request_invalid"),
        request_to("PATCH", "/cases/{case}", content=b'{"nail": "../../etc/passwd"}'),
    ),
    Attack(
        "path in an image's name",
        PORT,
        "read `../case-record.sqlite` as an image",
        "not_found",
        Record("ui_api", "not_found"),
        request_to("GET", "/images/..%2fcase-record.sqlite.dcm"),
    ),
)

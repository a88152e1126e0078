"""Bad input to a running installation: one clear sentence each, nothing lost, nothing half-written."""

import json
import os
import re
import socket
import subprocess
import sys
from importlib.resources import files
from io import BytesIO
from pathlib import Path

import httpx
import numpy as np
import pytest
from pydicom import dcmread, dcmwrite
from pydicom.uid import generate_uid
from pynetdicom import AE

from benchmarks.common.operating_room import OperatingRoom
from distalock.case_client import CaseClient, codes_of, is_accepted, summary_of
from distalock.client import RequestRefused
from distalock.rest_client import JsonObject, bearer

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def case(site: OperatingRoom) -> CaseClient:
    return site.open_case()


@pytest.fixture(scope="module")
def good_dicom(site: OperatingRoom, case: CaseClient) -> bytes:
    """An image of the virtual C-arm, which the case has localised."""
    seen = case.localisation_of(site.room.take_shot())
    assert is_accepted(seen), summary_of(seen)
    return site.control.get_bytes("/shots/last.dcm")


def store(site: OperatingRoom, content: bytes) -> int:
    """Send a DICOM file as a C-arm would; the status of the answer."""
    dataset = dcmread(BytesIO(content), force=True)
    entity = AE(ae_title="TEST")
    entity.add_requested_context(dataset.SOPClassUID, dataset.file_meta.TransferSyntaxUID)
    association = entity.associate("127.0.0.1", site.installation.ports.dicom, ae_title="DISTALOCK")
    assert association.is_established
    try:
        return int(association.send_c_store(dataset).Status)
    finally:
        association.release()


def changed_dicom(content: bytes, *, invert: bool, tagged: bool) -> bytes:
    """The same image under a new name, its grey values reversed, with or without the tag that says so."""
    dataset = dcmread(BytesIO(content))
    dataset.SOPInstanceUID = generate_uid()
    dataset.file_meta.MediaStorageSOPInstanceUID = dataset.SOPInstanceUID
    top = 2 ** int(dataset.BitsStored) - 1
    pixels = dataset.pixel_array
    dataset.PixelData = (top - pixels if invert else pixels).astype(np.uint16).tobytes()
    for tag in ("PixelIntensityRelationshipSign", "PixelIntensityRelationship"):
        if tag in dataset:
            delattr(dataset, tag)
    if tagged:
        dataset.PixelIntensityRelationship = "LIN"
        dataset.PixelIntensityRelationshipSign = -1 if invert else 1
    buffer = BytesIO()
    dcmwrite(buffer, dataset)
    return buffer.getvalue()


def stored_files(site: OperatingRoom) -> set[str]:
    return {p.name for p in (site.installation.state_dir / "images").rglob("*") if p.is_file()}


def test_a_truncated_dicom_is_refused_and_leaves_nothing(site: OperatingRoom, good_dicom: bytes) -> None:
    before = stored_files(site)
    truncated = dcmread(BytesIO(good_dicom))
    truncated.PixelData = truncated.PixelData[: len(truncated.PixelData) // 3]
    buffer = BytesIO()
    dcmwrite(buffer, truncated)
    assert store(site, buffer.getvalue()) & 0xF000 == 0xC000
    assert stored_files(site) == before


def test_a_tagged_image_of_the_other_polarity_is_normalised(
    site: OperatingRoom, case: CaseClient, good_dicom: bytes
) -> None:
    inverted = changed_dicom(good_dicom, invert=True, tagged=True)
    assert store(site, inverted) == 0
    seen = case.localisation_of(str(dcmread(BytesIO(inverted)).SOPInstanceUID))
    assert is_accepted(seen), summary_of(seen)


@pytest.mark.requirement("IMG-01")
def test_an_untagged_inverted_image_is_rejected(site: OperatingRoom, case: CaseClient, good_dicom: bytes) -> None:
    inverted = changed_dicom(good_dicom, invert=True, tagged=False)
    assert store(site, inverted) == 0
    seen = case.localisation_of(str(dcmread(BytesIO(inverted)).SOPInstanceUID))
    print(summary_of(seen))
    assert codes_of(seen) == ("image_unusable",)
    with pytest.raises(RequestRefused):
        case.plan(seen.number, ["distal"])


def set_up(site: OperatingRoom, **changes: object) -> JsonObject:
    return {**site.room.scenario().set_up, **changes}


def part(name: str) -> JsonObject:
    content = json.loads((files("shared.parts") / "catalogue" / f"{name}.json").read_text())
    assert isinstance(content, dict)
    return content


def refused(site: OperatingRoom, method: str, path: str, body: object) -> httpx.Response:
    """A request that must be refused with one sentence in a problem document."""
    url = f"{site.installation.ports.rest_url}/api/v1{path}"
    headers = {"Idempotency-Key": os.urandom(8).hex(), **bearer(site.installation.token)}
    if (case := re.match(r"/cases/[^/]+", path)) is not None:
        headers["If-Match"] = site.rest.etag(f"/api/v1{case[0]}")
    response = httpx.request(method, url, json=body, headers=headers)
    assert 400 <= response.status_code < 500, response.text
    assert response.headers["content-type"].startswith("application/problem+json")
    problem = response.json()
    print(response.status_code, problem["code"], problem["detail"])
    assert problem["detail"].strip()
    assert "\n" not in problem["detail"]
    return response


def test_a_part_with_an_unknown_key_is_refused(site: OperatingRoom, case: CaseClient) -> None:
    guide = {**part("guide-28"), "colour": "blue"}
    assert "colour" in refused(site, "PATCH", f"/cases/{case.id}", {"guide": guide}).json()["detail"]


def test_a_ring_with_a_wrong_count_is_refused(site: OperatingRoom, case: CaseClient) -> None:
    ring = {**part("ring-120"), "ball_count": 119}
    detail = refused(site, "PATCH", f"/cases/{case.id}", {"ring": ring}).json()["detail"]
    assert "119" in detail
    assert "120" in detail


def test_an_unknown_hole_is_refused(site: OperatingRoom, case: CaseClient, good_dicom: bytes) -> None:
    assert good_dicom
    number = case.newest_localisation().number
    body = {"localisation": number, "hole_ids": ["middle"]}
    assert "middle" in refused(site, "POST", f"/cases/{case.id}/plans", body).json()["detail"]


def test_a_second_open_case_is_refused(site: OperatingRoom, case: CaseClient) -> None:
    assert case.id
    refused(site, "POST", "/cases", set_up(site))


def distalock(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "distalock", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def one_line(result: subprocess.CompletedProcess[str]) -> str:
    assert result.returncode == 2, (result.stdout, result.stderr)
    assert result.stderr.count("\n") == 1, result.stderr
    print(result.stderr.strip())
    return result.stderr


def test_a_port_in_use_is_refused_before_anything_starts(tmp_path: Path) -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        port = str(holder.getsockname()[1])
        line = one_line(distalock("up", "--simulate", "--state", str(tmp_path / "s"), "--rest-port", port))
    assert port in line
    assert "--rest-port" in line
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize("service", ["imaging", "registration", "robot", "ui_api"])
def test_no_router_is_one_sentence(service: str, tmp_path: Path) -> None:
    environment = {
        **os.environ,
        "DISTALOCK_ROUTER_ENDPOINT": "tcp/127.0.0.1:1",
        "DISTALOCK_ROUTER_TIMEOUT_S": "1",
        "DISTALOCK_STATE_DIR": str(tmp_path),
        "DISTALOCK_UI_API_PORT": "0",
        "DISTALOCK_IMAGING_DICOM_PORT": "0",
    }
    command = [sys.executable, "-m", f"services.{service}"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=environment)
    last = result.stderr.strip().splitlines()[-1]
    print(last)
    assert result.returncode == 2
    assert "127.0.0.1:1" in last
    assert "router" in last
    assert "Traceback" not in result.stderr

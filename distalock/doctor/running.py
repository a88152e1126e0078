"""What runs: the gateway's own checks, DICOM reception, and without an installation the controller."""

import socket
from collections.abc import Iterator, Mapping
from contextlib import closing
from typing import Final

from distalock.readiness import Server
from services.imaging.settings import ImagingSettings
from services.robot.devices.dialects import DIALECTS
from services.robot.devices.identity import asked_identity
from services.robot.devices.serial_port import open_port
from services.robot.settings import RobotSettings
from shared.doctor.finding import Finding, attention, of_running, unknown, well, wrong
from shared.errors import DeviceError

# Chosen: a person waits for it.
_ANSWER_WITHIN_S: Final = 3.0
_LOOPBACK: Final = "127.0.0.1"


def gateway_findings(gateway: Server) -> Iterator[Finding]:
    """What `readyz` says of each part; one finding when nobody answers."""
    answer = gateway.answer("/readyz")
    if answer is None:
        yield unknown(
            "gateway",
            f"nobody answers at {gateway.url}",
            "start it, or give its ports as to `up`",
        )
        return
    for check in answer.json()["checks"]:
        yield of_running(check["name"], check["measured"], check["remedy"], does_its_work=check["ok"])


def dicom_finding(settings: ImagingSettings, *, running: bool) -> Finding:
    """An echo (C-ECHO) as the C-arm's first title would send it."""
    host = settings.dicom_host if settings.dicom_host not in ("0.0.0.0", "::") else _LOOPBACK  # noqa: S104 - compared
    place = f"{settings.dicom_ae_title}@{host}:{settings.dicom_port}"
    if settings.dicom_tls:
        return unknown("DICOM", f"{place} wants a sender's certificate", "send an echo from the C-arm")
    from pynetdicom.ae import ApplicationEntity  # loaded when wanted: it takes half a second
    from pynetdicom.sop_class import Verification  # type: ignore[attr-defined]  # made at run time

    titles = settings.dicom_calling_ae_titles
    # What nobody listens at leaves its socket open there, and lines in the log: so it is looked at first.
    if not _listens(host, settings.dicom_port):
        if running:
            return wrong("DICOM", f"nobody listens at {place}", "compare the port with the settings of imaging")
        return unknown("DICOM", f"nobody receives images at {place}", "start the installation")
    entity = ApplicationEntity(ae_title=titles[0] if titles else "DOCTOR")
    entity.acse_timeout = entity.dimse_timeout = entity.network_timeout = _ANSWER_WITHIN_S
    entity.connection_timeout = _ANSWER_WITHIN_S
    entity.add_requested_context(Verification)
    association = entity.associate(host, settings.dicom_port, ae_title=settings.dicom_ae_title)
    if not association.is_established:
        return wrong("DICOM", f"{place} takes no association", "compare titles with the settings of imaging")
    status = association.send_c_echo()
    association.release()
    if status and status.Status == 0:
        return well("DICOM", f"{place} answers an echo")
    return wrong("DICOM", f"{place} does not answer an echo", "look into the log of imaging")


def ports_finding(ports: Mapping[str, int], *, running: bool) -> Finding:
    """Whether the ports are free for an installation that is to be started."""
    if running:
        return well("ports", "held by the installation that runs")
    held = [f"{port} ({name})" for name, port in ports.items() if not _is_free(port)]
    if held:
        return wrong("ports", f"held by another program: {', '.join(held)}", "end it, or choose other ports")
    return well("ports", ", ".join(f"{port} ({name})" for name, port in ports.items()) + " are free")


def controller_finding(url: str | None, settings: RobotSettings, *, running: bool) -> Finding:
    """Who the controller says that it is; only where no robot service holds the line."""
    if running:
        return unknown("controller", "the robot service holds its line", "see `running: robot state`")
    if url is None:
        return unknown("controller", "no controller was named", "name it with --controller")
    try:
        with closing(open_port(url, settings.controller_baud)) as port:
            answer = asked_identity(port, DIALECTS[settings.dialect].identity_question, _ANSWER_WITHIN_S)
    except (DeviceError, OSError) as error:
        return wrong("controller", str(error), "see to the line, and who else holds it")
    if not answer:
        return wrong("controller", f"{url} is silent", "check its power, its cable and the baud rate")
    if not answer.isprintable() or "\\x" in answer:
        return attention("controller", f"{url} answers {answer}", "check the baud rate and the dialect")
    return well("controller", answer)


def _listens(host: str, port: int) -> bool:
    try:
        socket.create_connection((host, port), _ANSWER_WITHIN_S).close()
    except OSError:
        return False
    return True


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((_LOOPBACK, port))
        except OSError:
            return False
    return True

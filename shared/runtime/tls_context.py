"""TLS for servers that face the hospital's network: HTTPS and DICOM.

BCP 195 (RFC 9325), which DICOM PS3.15 B.12 makes a profile of: TLS 1.3, or 1.2 with ephemeral keys and authenticated
encryption alone.
"""

import ssl
from enum import Enum
from typing import Final

from shared.bus.tls import TlsFiles
from shared.errors import ConfigurationError

# RFC 9325, section 4.2: what TLS 1.2 may use. Those of TLS 1.3 are all of that kind.
_TLS_1_2_SUITES: Final = (
    "ECDHE-ECDSA-AES128-GCM-SHA256",
    "ECDHE-RSA-AES128-GCM-SHA256",
    "ECDHE-ECDSA-AES256-GCM-SHA384",
    "ECDHE-RSA-AES256-GCM-SHA384",
)


class Clients(Enum):
    """Whom a server lets in."""

    ANYBODY = "anybody"
    WITH_CERTIFICATE = "whoever has a certificate of the authority"


def server_context(files: TlsFiles, clients: Clients) -> ssl.SSLContext:
    """Context of a server with its certificate.

    Raises
    ------
    ConfigurationError
        When a file is missing or cannot be used, or others can read the key.
    """
    if clients is Clients.WITH_CERTIFICATE:
        files.require()
    else:
        files.require_own()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers(":".join(_TLS_1_2_SUITES))
    context.options |= ssl.OP_NO_COMPRESSION | ssl.OP_NO_RENEGOTIATION
    try:
        context.load_cert_chain(files.certificate, files.key)
        if clients is Clients.WITH_CERTIFICATE:
            context.load_verify_locations(files.authority)
            context.verify_mode = ssl.CERT_REQUIRED
    except (ssl.SSLError, OSError) as error:
        raise ConfigurationError(
            f"{files.certificate} and {files.key} cannot be used for TLS ({error}); make new ones (distalock pki issue)"
        ) from None
    return context

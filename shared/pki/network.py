"""Keys and certificates of what faces the hospital's network: browsers, programs and C-arms.

::

    pki/network/authority/{authority.pem, key.pem}   what signs them; `authority.pem` goes to browsers and C-arms
    pki/network/rest/                                 the gateway's HTTPS server
    pki/network/dicom/                                imaging's DICOM server under TLS
    pki/network/c_arm/                                for the C-arm, which is a client

They have an authority of their own. The bus believes the other one alone: a certificate for HTTPS is a server's for
this host, as the router's is, and under one authority whoever has the gateway's could play the router.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from shared.bus.tls import NETWORK_FOLDER
from shared.pki.authority import Use
from shared.pki.keystore import HERE, Holder, Keystore

REST: Final = "rest"
DICOM: Final = "dicom"
C_ARM: Final = "c_arm"
NETWORK: Final[Mapping[str, Holder]] = {
    REST: Holder(Use.SERVER, (*HERE, "ui_api")),
    DICOM: Holder(Use.SERVER, (*HERE, "imaging")),
    C_ARM: Holder(Use.CLIENT),
}


def network_keystore(pki_folder: Path) -> Keystore:
    """The folder of the network's keys and certificates within that of the installation's."""
    return Keystore(pki_folder / NETWORK_FOLDER, NETWORK)

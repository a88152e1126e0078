"""An authenticator in software: makes a passkey and signs with it, as a phone or a security key would."""

import hashlib
import json
import secrets
from collections.abc import Mapping
from typing import Any

from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from fido2.cose import ES256
from fido2.utils import websafe_encode
from fido2.webauthn import Aaguid, AttestationObject, AttestedCredentialData, AuthenticatorData

ORIGIN = "http://localhost:8000"


class SoftwarePasskey:
    """One passkey. `uses` is its counter; tests set it to play a copy."""

    def __init__(self, origin: str = ORIGIN, host: str = "localhost", *, verifies_user: bool = True) -> None:
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._id, self._origin, self._host = secrets.token_bytes(32), origin, host
        self._verified = AuthenticatorData.FLAG.UV if verifies_user else AuthenticatorData.FLAG(0)
        self.uses = 0

    def made_for(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """What `navigator.credentials.create` gives for these options, as its toJSON()."""
        client_data = self._client_data("webauthn.create", options["challenge"])
        public_key = ES256.from_cryptography_key(self._key.public_key())  # type: ignore[no-untyped-call]
        attested = AttestedCredentialData.create(Aaguid.NONE, self._id, public_key)
        flags = AuthenticatorData.FLAG.UP | AuthenticatorData.FLAG.AT | self._verified
        data = AuthenticatorData.create(self._host_hash, flags, self.uses, bytes(attested))
        attestation = AttestationObject.create("none", data, {})
        response = {"clientDataJSON": websafe_encode(client_data), "attestationObject": websafe_encode(attestation)}
        return self._credential(response)

    def signed(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """What `navigator.credentials.get` gives for these options, as its toJSON()."""
        self.uses += 1
        client_data = self._client_data("webauthn.get", options["challenge"])
        flags = AuthenticatorData.FLAG.UP | self._verified
        data = AuthenticatorData.create(self._host_hash, flags, self.uses)
        text = bytes(data) + hashlib.sha256(client_data).digest()
        signature = self._key.sign(text, ec.ECDSA(hashes.SHA256()))
        return self._credential(
            {
                "clientDataJSON": websafe_encode(client_data),
                "authenticatorData": websafe_encode(data),
                "signature": websafe_encode(signature),
            }
        )

    @property
    def _host_hash(self) -> bytes:
        return hashlib.sha256(self._host.encode()).digest()

    def _client_data(self, kind: str, challenge: str) -> bytes:
        return json.dumps({"type": kind, "challenge": challenge, "origin": self._origin}).encode()

    def _credential(self, response: Mapping[str, Any]) -> dict[str, Any]:
        name = websafe_encode(self._id)
        return {"id": name, "rawId": name, "type": "public-key", "response": dict(response)}

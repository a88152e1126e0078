"""Settings of the gateway: `DISTALOCK_UI_API_*`, or the table `[ui_api]` of the settings file."""

from pathlib import Path
from typing import Annotated, ClassVar, Final

from pydantic import Field, IPvAnyNetwork

from services.ui_api.core.access_settings import AccessSettings, ProviderSettings
from services.ui_api.core.networks import PRIVATE_NETWORKS
from services.ui_api.core.rate_limit import RateSettings
from services.ui_api.core.roles import Role
from services.ui_api.record.location import sqlite_url
from shared.bus.tls import PKI_FOLDER, TlsFiles
from shared.errors import ConfigurationError
from shared.hosts import is_loopback
from shared.parts.approvals import PartApprovals
from shared.pki.permit_key import PERMIT_KEY_FILE, PermitSigner
from shared.pki.private_files import read_file
from shared.runtime.settings import ServiceSettings

_LEAST_TOKEN_CHARACTERS: Final = 32
HostName = Annotated[str, Field(min_length=1, max_length=253, pattern=r"^[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?$")]

HttpAddress = Annotated[str, Field(max_length=300, pattern=r"^http://[A-Za-z0-9.\[\]:-]+$")]
Origin = Annotated[str, Field(max_length=300, pattern=r"^https?://[A-Za-z0-9.\[\]:-]+$")]
# Over TLS, or on this machine.
ProviderUrl = Annotated[
    str, Field(max_length=300, pattern=r"^(https://[^\s?#]+|http://(localhost|127\.0\.0\.1)(:\d+)?[^\s?#]*)$")
]


class UiApiSettings(ServiceSettings):
    """What the gateway needs to know beyond what every service does."""

    section: ClassVar[str] = "ui_api"

    host: str = Field("127.0.0.1", description="Address on which the REST interface listens.")
    port: Annotated[int, Field(ge=0, le=65535)] = Field(8000, description="Port of the REST interface; 0: any free.")
    https: bool = Field(
        default=False, description="HTTPS in place of HTTP; needed on an address that is not the loopback interface's."
    )
    https_certificate: Path | None = Field(
        None, description="The server's certificate; default: pki/network/rest in state_dir, as the key."
    )
    https_key: Path | None = Field(None, description="Private key of that certificate.")
    plain_http: bool = Field(
        default=False,
        description="HTTP on an address that is not the loopback interface's all the same, with a warning: whoever is "
        "on the way can read and change everything.",
    )
    allowed_hosts: tuple[HostName, ...] = Field(
        (), description="Names under which browsers may call this machine, besides its addresses and localhost."
    )
    passkey_host: HostName = Field(
        "localhost",
        description="Name under which browsers call this machine for passkeys, which are bound to it: HTTPS, or "
        "localhost.",
    )
    provider_issuer: ProviderUrl | None = Field(
        None, description="The hospital's identity provider (OpenID Connect), by its issuer URL. Default: none."
    )
    provider_client_id: str | None = Field(None, description="The gateway's name at the provider.")
    provider_client_secret_file: Path | None = Field(
        None, description="File with its secret there, readable by its owner alone; default: a client without one."
    )
    provider_scope: str = Field("openid profile", description="What is asked of the provider.")
    provider_name_claim: str = Field("preferred_username", description="Claim that is the account's name.")
    provider_roles_claim: str = Field("groups", description="Claim whose values stand for roles.")
    provider_roles: dict[str, Role] = Field(
        {}, description='Roles by the values of that claim, such as {"or-surgeons": "surgeon"}.'
    )
    cors_origins: tuple[Origin, ...] = Field(
        (),
        description="Origins of other servers whose pages may call this machine with an access token, such as "
        "https://console.hospital:8443. Default: none.",
    )
    unapproved_parts: bool = Field(
        default=False, description="Take part files that no administrator has approved, as a simulation may."
    )
    database_url: str | None = Field(None, description="Case record; default: a SQLite file in the state folder.")
    image_dir: Path | None = Field(None, description="Where imaging stores its files; default: images in state_dir.")
    permit_key: Path | None = Field(
        None, description="Key that signs permits to move; default: in the folder pki of the state folder."
    )
    robot_state_stale_after_s: Annotated[float, Field(gt=0.0, le=10.0)] = Field(
        1.0, description="Age from which the robot's state is no longer relied on."
    )
    room_networks: tuple[IPvAnyNetwork, ...] = Field(
        PRIVATE_NETWORKS,
        description="The room's own networks: from there a stop and /metrics need no login. Default: loopback, private "
        "and link-local addresses.",
    )
    requests_per_s: Annotated[float, Field(ge=0.0, le=1e5)] = Field(
        100.0, description="Requests a second of one access token, ten times as many at once; 0: no limit."
    )
    requests_per_address_per_s: Annotated[float, Field(ge=0.0, le=1e5)] = Field(
        400.0,
        description="The same of one address, whoever asks; behind a proxy all have the proxy's. 0: no limit.",
    )
    demo_token_file: Path | None = Field(
        None, description="File with the token of the user demo, who may do everything: for simulations."
    )
    virtual_room_url: HttpAddress | None = Field(
        None, description="Control API of the virtual operating room, which the console then shows: for simulations."
    )
    lease_s: Annotated[float, Field(ge=0.1, le=2.0)] = Field(
        0.5, description="How long a hold-to-move lease lasts without renewal."
    )
    run_calibrations: Annotated[int, Field(ge=0, le=256)] = Field(
        8,
        description="Newest frames of a fluoroscopy whose calibrations go on record when it has ended, besides those "
        "of frames that were localised. Single shots are always recorded.",
    )

    def permit_signer(self) -> PermitSigner:
        """Signs permits to move; raises `ConfigurationError`."""
        return PermitSigner.from_file(self.permit_key or self.state_dir / PKI_FOLDER / self.section / PERMIT_KEY_FILE)

    def access(self) -> AccessSettings:
        """Settings of access control; raises `ConfigurationError`."""
        token = None if self.demo_token_file is None else read_file(self.demo_token_file).decode("ascii").strip()
        if token is not None and len(token) < _LEAST_TOKEN_CHARACTERS:
            raise ConfigurationError(
                f"{self.demo_token_file}: the token has {len(token)} characters, and must have at least "
                f"{_LEAST_TOKEN_CHARACTERS}; delete the file, and `distalock up --simulate` makes a new one"
            )
        rates = RateSettings(self.requests_per_s, self.requests_per_address_per_s)
        return AccessSettings(self.state_dir, self.room_networks, token, self.passkey_host, self._provider(), rates)

    def _provider(self) -> ProviderSettings | None:
        if self.provider_issuer is None:
            return None
        if not self.provider_client_id or not self.provider_roles:
            raise ConfigurationError(
                "an identity provider is set, and its client id or its roles are not; set "
                "DISTALOCK_UI_API_PROVIDER_CLIENT_ID and DISTALOCK_UI_API_PROVIDER_ROLES"
            )
        file = self.provider_client_secret_file
        return ProviderSettings(
            issuer=self.provider_issuer,
            client_id=self.provider_client_id,
            client_secret=None if file is None else read_file(file).decode("ascii").strip(),
            scope=self.provider_scope,
            name_claim=self.provider_name_claim,
            roles_claim=self.provider_roles_claim,
            roles=self.provider_roles,
        )

    def part_is_approved(self, sha256: str) -> bool:
        """Whether a part file may be used; raises `ConfigurationError` when the approvals cannot be read."""
        return self.unapproved_parts or PartApprovals(self.state_dir).holds(sha256)

    def https_files(self) -> TlsFiles | None:
        """Key and certificate for HTTPS; None for HTTP.

        Raises
        ------
        ConfigurationError
            When the address is not the loopback interface's, and neither HTTPS nor `plain_http` is set.
        """
        if self.https:
            made = TlsFiles.in_network(self.state_dir, "rest")
            return TlsFiles(made.authority, self.https_certificate or made.certificate, self.https_key or made.key)
        if not (self.plain_http or is_loopback(self.host)):
            raise ConfigurationError(
                f"the REST interface would listen on {self.host} without TLS, and whoever is on the way could read and "
                "change everything; set DISTALOCK_UI_API_HTTPS=true, or say that you want it so "
                "(DISTALOCK_UI_API_PLAIN_HTTP=true)"
            )
        return None

    def record_url(self) -> str:
        """URL of the case record's database."""
        return self.database_url or sqlite_url(self.state_dir)

    def images(self) -> Path:
        """Folder of the stored images."""
        return self.image_dir or self.state_dir / "images"

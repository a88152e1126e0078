"""What clients send to sign in and to administer accounts; passwords never stand in a log or an answer."""

from typing import Annotated, Literal

from pydantic import Field, SecretStr

from services.ui_api.core.roles import Role
from services.ui_api.routes.bodies import Body, Password, UserName

RoleName = Literal["viewer", "technician", "surgeon", "administrator"]
RoleNames = Annotated[list[RoleName], Field(min_length=1, max_length=4, description="One role, or several.")]
Keep = Annotated[
    Literal["bearer", "cookie"],
    Field(
        description="`bearer`: the tokens are in the answer, for programs. `cookie`: they are in cookies that scripts "
        "cannot read, for pages."
    ),
]


class LoginBody(Body):
    """Opens a session."""

    name: UserName
    password: Password
    keep: Keep = "bearer"


class RefreshBody(Body):
    """Renews a session; a page leaves the token out, for it is in its cookie."""

    refresh_token: Annotated[SecretStr, Field(min_length=1, max_length=256)] | None = None


class FirstAccountBody(Body):
    """The form of the page for the first account."""

    name: UserName
    password: Password


class UserBody(Body):
    """Makes an account."""

    name: UserName
    password: Password
    roles: RoleNames


class UserPatch(Body):
    """Changes an account; what is left out stays. All its sessions end."""

    password: Password | None = None
    roles: RoleNames | None = None
    disabled: bool | None = None


class PasswordBody(Body):
    """Changes the own password; the other sessions end."""

    password: Password
    new_password: Password


def roles_of(names: list[RoleName]) -> frozenset[Role]:
    """The roles of these names."""
    return frozenset(Role(name) for name in names)

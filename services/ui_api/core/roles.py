"""Who may do what over REST: one table of roles and actions. Pure; `docs/rest.md` prints it.

An account has one role or several. Every route names its action (`routes.guards`), and a route without one cannot be
made.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class Role(StrEnum):
    """What somebody is in the operating room, or for the installation."""

    VIEWER = "viewer"
    TECHNICIAN = "technician"
    SURGEON = "surgeon"
    ADMINISTRATOR = "administrator"


class Action(StrEnum):
    """What a request does."""

    SEE_HEALTH = "see_health"
    OPEN_CONSOLE = "open_console"
    SIGN_IN = "sign_in"
    STOP = "stop"
    SEE_METRICS = "see_metrics"
    USE_OWN_ACCOUNT = "use_own_account"
    DIAGNOSE = "diagnose"
    READ = "read"
    OPEN_CASE = "open_case"
    CHANGE_SET_UP = "change_set_up"
    RECORD_STEP = "record_step"
    PLAN = "plan"
    VERIFY = "verify"
    REPORT_QUALITY = "report_quality"
    COMPUTE = "compute"
    PREPARE_ROBOT = "prepare_robot"
    APPROVE_PLAN = "approve_plan"
    MOVE = "move"
    ADMINISTER_USERS = "administer_users"


class WithoutLogin(StrEnum):
    """Who may do it without being signed in."""

    NOBODY = "nobody"
    ROOM = "the room's network"
    ANYBODY = "anybody"


@dataclass(frozen=True, slots=True)
class Permission:
    """One row of the table.

    Attributes
    ----------
    what
        What the action covers, for people.
    """

    action: Action
    roles: frozenset[Role]
    what: str
    without_login: WithoutLogin = WithoutLogin.NOBODY


_EVERYBODY: Final = frozenset(Role)
_CLINICAL: Final = frozenset({Role.VIEWER, Role.TECHNICIAN, Role.SURGEON})
_STAFF: Final = frozenset({Role.TECHNICIAN, Role.SURGEON})
_SURGEON: Final = frozenset({Role.SURGEON})

PERMISSIONS: Final = (
    Permission(Action.SEE_HEALTH, _EVERYBODY, "whether the process runs and what is not ready", WithoutLogin.ANYBODY),
    Permission(
        Action.OPEN_CONSOLE, _EVERYBODY, "load the console's page, which shows nothing yet", WithoutLogin.ANYBODY
    ),
    Permission(
        Action.SIGN_IN, _EVERYBODY, "sign in, renew a session, make the first account by its link", WithoutLogin.ANYBODY
    ),
    Permission(Action.STOP, _EVERYBODY, "stop the robot", WithoutLogin.ROOM),
    Permission(Action.SEE_METRICS, _EVERYBODY, "figures for Prometheus", WithoutLogin.ROOM),
    Permission(Action.USE_OWN_ACCOUNT, _EVERYBODY, "see the own account, change its password, sign out"),
    Permission(
        Action.DIAGNOSE,
        frozenset({Role.TECHNICIAN, Role.SURGEON, Role.ADMINISTRATOR}),
        "what of machine and installation needs attention, with remedies",
    ),
    Permission(Action.READ, _CLINICAL, "cases, images, results, robot, events, live picture, parts"),
    Permission(Action.OPEN_CASE, _STAFF, "open a case"),
    Permission(Action.CHANGE_SET_UP, _STAFF, "change the set-up of a case"),
    Permission(Action.RECORD_STEP, _STAFF, "record what people did with their hands; close a case"),
    Permission(Action.PLAN, _STAFF, "plan from a localisation"),
    Permission(Action.VERIFY, _STAFF, "compare wires or guide with the hole axes"),
    Permission(Action.REPORT_QUALITY, _STAFF, "quality reports"),
    Permission(Action.COMPUTE, _STAFF, "verify, plan or report without waiting for it; cancel that"),
    Permission(Action.PREPARE_ROBOT, _STAFF, "acknowledge a stop, reference, reset"),
    Permission(Action.APPROVE_PLAN, _SURGEON, "approve a plan, with the credential again"),
    Permission(Action.MOVE, _SURGEON, "begin the motion of an approved plan, hold its lease"),
    Permission(
        Action.ADMINISTER_USERS, frozenset({Role.ADMINISTRATOR}), "make, change and disable accounts, end sessions"
    ),
)
PERMISSION_OF: Final = {permission.action: permission for permission in PERMISSIONS}


def may(roles: Iterable[Role], action: Action) -> bool:
    """Whether somebody with these roles may do it."""
    return not PERMISSION_OF[action].roles.isdisjoint(roles)


def permission_lines() -> list[str]:
    """The table in Markdown: a row for each action, a column for each role."""
    head = f"| action | {' | '.join(Role)} | without login | |"
    rows = [
        f"| `{one.action}` | {' | '.join('yes' if role in one.roles else '' for role in Role)} | "
        f"{'' if one.without_login is WithoutLogin.NOBODY else one.without_login} | {one.what} |"
        for one in PERMISSIONS
    ]
    return [head, f"|---{'|---' * len(Role)}|---|---|", *rows]

"""Arguments of `distalock users`, apart from its work: bad ones are answered before anything heavy is imported."""

import argparse
from typing import Final

from distalock.arguments import Declares, add_actions, add_record_arguments
from services.ui_api.core.roles import Role


def _name(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", metavar="NAME", help="of the account")


def _new(parser: argparse.ArgumentParser) -> None:
    _roles(parser)
    _password(parser)


def _roles(parser: argparse.ArgumentParser) -> None:
    _name(parser)
    parser.add_argument(
        "--role",
        dest="roles",
        action="append",
        required=True,
        choices=[str(role) for role in Role],
        help="may be given several times",
    )


def _password_of(parser: argparse.ArgumentParser) -> None:
    _name(parser)
    _password(parser)


def _password(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--password-stdin", action="store_true", help="read the password from stdin in place of asking for it twice"
    )


def _nothing(_: argparse.ArgumentParser) -> None:
    """No arguments of its own."""


_ACTIONS: Final[dict[str, tuple[str, Declares]]] = {
    "list": ("accounts with their roles", _nothing),
    "add": ("make an account; asks for its password", _new),
    "password": ("set a new password, when the old one is lost", _password_of),
    "roles": ("replace the roles", _roles),
    "disable": ("nobody can sign in with it any more; it stays on record", _name),
    "enable": ("the contrary", _name),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    add_actions(parser, _ACTIONS, (add_record_arguments,))

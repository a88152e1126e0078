"""`distalock record ACTION`: what was asked for, on the record of one installation."""

import argparse
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Final

from sqlalchemy.exc import DBAPIError

from distalock.arguments import EXIT_BAD_INPUT
from services.ui_api.core.chain import ChainBroken
from services.ui_api.record.backup import back_up, restore
from services.ui_api.record.database import existing_database
from services.ui_api.record.engines import cause_of, shown
from services.ui_api.record.verify import verify_record
from services.ui_api.settings import UiApiSettings
from shared.errors import DistalockError
from shared.runtime.lifecycle import software_version
from shared.runtime.settings import load_settings

EXIT_GOOD, EXIT_BROKEN, EXIT_ATTENTION = 0, 1, 3


def run(given: argparse.Namespace) -> int:
    """Run the action; 1 when the record is broken, 3 when something needs attention."""
    try:
        settings = load_settings(
            UiApiSettings, state_dir=given.state.resolve(), database_url=given.database, image_dir=given.images
        )
        return _ACTIONS[given.action](given, settings)
    except DistalockError as error:
        return _refused(given.action, str(error))
    except OSError as error:
        return _refused(given.action, f"{error.filename}: {error.strerror or error}")
    except (DBAPIError, UnicodeDecodeError) as error:  # a damaged schema need not be text
        return _refused(given.action, f"case record {shown(settings.record_url())}: cannot be read: {cause_of(error)}")


def _refused(action: str, why: str) -> int:
    print(f"distalock record {action}: {why}", file=sys.stderr)
    return EXIT_BAD_INPUT


def _verify(_: argparse.Namespace, settings: UiApiSettings) -> int:
    verdict = verify_record(existing_database(settings.record_url()))
    if isinstance(verdict, ChainBroken):
        print(f"broken: {verdict.message}")
        return EXIT_BROKEN
    print(f"intact: {verdict.entries} events, head {verdict.head_sha256}")
    return EXIT_GOOD


def _backup(given: argparse.Namespace, settings: UiApiSettings) -> int:
    engine = existing_database(settings.record_url())
    made = back_up(engine, settings.images(), given.folder, datetime.now(UTC), software_version())
    print(f"backed up: {made.events} events, head {made.head_sha256}, {made.images} images")
    for finding, images in (("is missing", made.missing_images), ("is damaged", made.damaged_images)):
        for sha256 in images:
            print(f"image {sha256}, which the record names, {finding} in {settings.images()}")
    return EXIT_GOOD if made.is_complete else EXIT_ATTENTION


def _restore(given: argparse.Namespace, settings: UiApiSettings) -> int:
    chain = restore(given.folder, settings.record_url(), settings.images())
    print(f"restored: {chain.entries} events, head {chain.head_sha256}")
    return EXIT_GOOD


_ACTIONS: Final[dict[str, Callable[[argparse.Namespace, UiApiSettings], int]]] = {
    "verify": _verify,
    "backup": _backup,
    "restore": _restore,
}

"""`distalock record ACTION`: what was asked for, on the record of one installation."""

import argparse
import sqlite3
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from sqlalchemy import Engine
from sqlalchemy.exc import DBAPIError

from distalock.arguments import EXIT_BAD_INPUT
from services.ui_api.core.chain import ChainBroken, ChainIntact
from services.ui_api.core.retention import RetentionRules
from services.ui_api.record.anchors import append_anchor, read_anchors, verify_with_anchors
from services.ui_api.record.backup import back_up
from services.ui_api.record.database import existing_database, open_database, sole_gateway
from services.ui_api.record.deidentify.case import NOTES, deidentified
from services.ui_api.record.engines import cause_of, shown
from services.ui_api.record.export.content import read_case
from services.ui_api.record.export.folder import WrittenFolder, write_folder
from services.ui_api.record.prune import (
    PruningPlan,
    delete_pruned_images,
    give_back_space,
    plan_pruning,
    prune,
)
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.restore import restore
from services.ui_api.record.verify import verify_record
from services.ui_api.settings import UiApiSettings
from shared.errors import DistalockError, InputError
from shared.pki.signing_key import SigningKey, VerifyingKey
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
    except (DBAPIError, sqlite3.Error, UnicodeDecodeError) as error:  # a damaged schema need not be text
        return _refused(given.action, f"case record {shown(settings.record_url())}: cannot be used: {cause_of(error)}")


def _refused(action: str, why: str) -> int:
    print(f"distalock record {action}: {why}", file=sys.stderr)
    return EXIT_BAD_INPUT


def _verify(given: argparse.Namespace, settings: UiApiSettings) -> int:
    if (given.anchors is None) != (given.public_key is None):
        raise InputError("--anchors and --public-key belong together; give both or none")
    engine = existing_database(settings.record_url())
    if given.anchors is None:
        return _reported(verify_record(engine))
    key = VerifyingKey.from_file(given.public_key)
    anchors = read_anchors(given.anchors)
    verdict = verify_with_anchors(engine, anchors, key.sha256, key.has_signed)
    if isinstance(verdict, ChainIntact) and anchors:
        print(f"anchored: {anchors[-1].events} events at {anchors[-1].gen_time}, the last of {len(anchors)}")
    return _reported(verdict)


def _reported(verdict: ChainIntact | ChainBroken) -> int:
    if isinstance(verdict, ChainBroken):
        print(f"broken: {verdict.message}")
        return EXIT_BROKEN
    print(f"intact: {verdict.entries} events, head {verdict.head_sha256}")
    return EXIT_GOOD


def _anchor(given: argparse.Namespace, settings: UiApiSettings) -> int:
    """What does not hold is not countersigned: neither a broken record, nor one that is not what it was."""
    engine = existing_database(settings.record_url())
    anchors = read_anchors(given.anchors) if given.anchors.exists() else []
    key = SigningKey.from_file(given.key) if given.key.exists() or anchors else _new_key(given.key)
    public = key.public()
    verdict = verify_with_anchors(engine, anchors, public.sha256, public.has_signed)
    if isinstance(verdict, ChainBroken):
        return _reported(verdict)
    made = append_anchor(given.anchors, anchors, verdict, datetime.now(UTC), public.sha256, key.sign)
    print(f"anchored: {made.events} events, head {made.hashed_message}, anchor {made.serial_number} at {made.gen_time}")
    return EXIT_GOOD


def _new_key(file: Path) -> SigningKey:
    key = SigningKey.make(file)
    public = file.with_suffix(".pub")
    public.write_bytes(key.public().pem)
    print(f"made key {file}, and {public.name} beside it for whoever verifies")
    return key


def _backup(given: argparse.Namespace, settings: UiApiSettings) -> int:
    engine = existing_database(settings.record_url())
    made = back_up(engine, settings.images(), given.folder, datetime.now(UTC), software_version())
    print(f"backed up: {made.events} events, head {made.head_sha256}, {made.images} images")
    for finding, images in (("is missing", made.missing_images), ("is damaged", made.damaged_images)):
        for sha256 in images:
            print(f"image {sha256}, which the record names, {finding} in {settings.images()}")
    return EXIT_GOOD if made.is_complete else EXIT_ATTENTION


def _restore(given: argparse.Namespace, settings: UiApiSettings) -> int:
    restored = restore(given.folder, settings.record_url(), settings.images())
    print(f"restored: {restored.chain.entries} events, head {restored.chain.head_sha256}")
    kept = restored.kept_index
    if kept is not None and kept.is_newer:
        print(
            f"kept: the index of images in {settings.images()}, which ends with number {kept.newest}; the backup's "
            f"ends with {kept.of_backup}"
        )
    return EXIT_GOOD


def _export(given: argparse.Namespace, settings: UiApiSettings) -> int:
    case = read_case(existing_database(settings.record_url()), settings.images(), given.case)
    return _written(write_folder(case, given.out), given.out)


def _anonymise(given: argparse.Namespace, settings: UiApiSettings) -> int:
    case = read_case(existing_database(settings.record_url()), settings.images(), given.case)
    return _written(write_folder(deidentified(case), given.out, NOTES), given.out)


def _written(written: WrittenFolder, folder: Path) -> int:
    print(f"wrote {written.files} files; begin with {folder / 'README.md'}")
    head = "" if written.head_sha256 is None else f" --head {written.head_sha256}"
    print(f"send another way: python3 check.py --sums {written.sums_sha256} --events {written.events}{head}")
    for sentence in written.missing:
        print(sentence)
    return EXIT_ATTENTION if written.missing else EXIT_GOOD


def _prune(given: argparse.Namespace, settings: UiApiSettings) -> int:
    rules = RetentionRules(given.closed_days, given.frames_days)
    if not given.apply:
        return _listed(existing_database(settings.record_url()), rules)
    if not given.by:
        raise InputError("--apply needs --by NAME: who decides it goes on record")
    url = settings.record_url()
    existing_database(url).dispose()
    with sole_gateway(url):
        engine = open_database(url)
        record = CaseRecord(engine, time.time_ns)
        plan = plan_pruning(engine, record.ledger, rules, time.time_ns())
        prune(record, plan, given.by)
        files = delete_pruned_images(engine, settings.images())
        give_back_space(engine)
        engine.dispose()
    _print_plan(plan)
    print(f"deleted: {files.deleted} image files; what was pruned stands in the record as events")
    for file in files.kept:
        print(f"{file} could not be deleted; see to its folder, and prune again")
    return EXIT_ATTENTION if files.kept else EXIT_GOOD


def _listed(engine: Engine, rules: RetentionRules) -> int:
    record = CaseRecord(engine, time.time_ns)
    plan = plan_pruning(engine, record.ledger, rules, time.time_ns())
    _print_plan(plan)
    print("nothing was changed; --apply --by NAME does it")
    return EXIT_GOOD


def _print_plan(plan: PruningPlan) -> None:
    for case in plan.cases:
        events = sum(last - first + 1 for first, last in case.event_ranges)
        print(
            f"case {case.pruned_case_id}: {events} events, {len(case.documents)} documents, {len(case.images)} images "
            f"({case.rule})"
        )
    if plan.images is not None:
        print(f"images: {len(plan.images.images)} files ({plan.images.rule})")


_ACTIONS: Final[dict[str, Callable[[argparse.Namespace, UiApiSettings], int]]] = {
    "verify": _verify,
    "backup": _backup,
    "anchor": _anchor,
    "export": _export,
    "anonymise": _anonymise,
    "prune": _prune,
    "restore": _restore,
}

"""Both databases refuse changes of what was recorded; what is pruned must be declared first.

An event's content may become empty, its hashes staying, when `prunings` names its case; a document may go when
`documents_to_prune` names it. Both name the event that records it, and both are themselves append-only.
"""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

_KEPT = ("sequence", "at_ns", "case_id", "kind", "previous_sha256", "sha256")
_ERASED = ("who", "why", "data_json")
_UNIQUE = {
    "events": ("sequence", "previous_sha256", "sha256"),
    "documents": ("sha256",),
    "prunings": ("case_id",),
    "documents_to_prune": ("sha256",),
}
_TELLS_OF_PRUNING = "SELECT 1 FROM events WHERE sequence = NEW.event_sequence AND kind = 'case_pruned'"
_CASE_IS_DECLARED = "SELECT 1 FROM prunings WHERE case_id = OLD.case_id AND OLD.sequence < event_sequence"
_DOCUMENT_IS_DECLARED = "SELECT 1 FROM documents_to_prune WHERE sha256 = OLD.sha256"


def upgrade() -> None:
    """Make the tables of what is to be pruned, and the triggers."""
    op.create_table(
        "prunings",
        sa.Column("case_id", sa.String(64), primary_key=True),
        sa.Column("event_sequence", sa.Integer, sa.ForeignKey("events.sequence"), nullable=False),
    )
    op.create_table(
        "documents_to_prune",
        sa.Column("sha256", sa.String(64), primary_key=True),
        sa.Column("event_sequence", sa.Integer, sa.ForeignKey("events.sequence"), nullable=False),
    )
    if op.get_bind().dialect.name == "sqlite":
        _refuse_changes_in_sqlite()
    else:
        _refuse_changes_in_postgresql()


def downgrade() -> None:
    """There is no way back: a record without its triggers is not the same record."""
    raise NotImplementedError("restore a backup that the older version made")


def _refuse_changes_in_sqlite() -> None:
    for table in ("events", "documents"):
        for verb in ("update", "delete"):
            op.execute(f"DROP TRIGGER {table}_refuse_{verb}")
    kept = " AND ".join(f"NEW.{column} IS OLD.{column}" for column in _KEPT)
    erased = " AND ".join(f"NEW.{column} = ''" for column in _ERASED)
    _sqlite_trigger("events", "update", f"NOT ({kept} AND {erased} AND EXISTS ({_CASE_IS_DECLARED}))")
    _sqlite_trigger("events", "delete")
    _sqlite_trigger("documents", "update")
    _sqlite_trigger("documents", "delete", f"NOT EXISTS ({_DOCUMENT_IS_DECLARED})")
    _sqlite_trigger("prunings", "update")
    _sqlite_trigger("prunings", "delete")
    _sqlite_trigger("documents_to_prune", "update")
    # Used up by the deletion that it declares, and not before.
    _sqlite_trigger(
        "documents_to_prune", "delete", "EXISTS (SELECT 1 FROM documents WHERE documents.sha256 = OLD.sha256)"
    )
    op.execute(
        "CREATE TRIGGER documents_deleted AFTER DELETE ON documents "
        "BEGIN DELETE FROM documents_to_prune WHERE sha256 = OLD.sha256; END"
    )
    for table, columns in _UNIQUE.items():
        # INSERT OR REPLACE deletes without calling the triggers for that.
        taken = " OR ".join(f"{column} = NEW.{column}" for column in columns)
        refused = f"EXISTS (SELECT 1 FROM {table} WHERE {taken})"  # noqa: S608 - constants
        if table in {"prunings", "documents_to_prune"}:
            refused = f"{refused} OR NOT EXISTS ({_TELLS_OF_PRUNING})"
        _sqlite_trigger(table, "insert", refused)


def _sqlite_trigger(table: str, verb: str, when: str = "1") -> None:
    op.execute(
        f"CREATE TRIGGER {table}_refuse_{verb} BEFORE {verb.upper()} ON {table} WHEN {when} "
        f"BEGIN SELECT RAISE(ABORT, '{table} are append-only'); END"
    )


def _refuse_changes_in_postgresql() -> None:
    kept = ", ".join(f"NEW.{column}" for column in _KEPT), ", ".join(f"OLD.{column}" for column in _KEPT)
    erased = " AND ".join(f"NEW.{column} = ''" for column in _ERASED)
    _postgresql_trigger(
        "events",
        "update",
        f"({kept[0]}) IS NOT DISTINCT FROM ({kept[1]}) AND {erased} AND EXISTS ({_CASE_IS_DECLARED})",
    )
    _postgresql_trigger("events", "delete")
    _postgresql_trigger("documents", "update")
    _postgresql_trigger("documents", "delete", f"EXISTS ({_DOCUMENT_IS_DECLARED})")
    for table in ("prunings", "documents_to_prune"):
        _postgresql_trigger(table, "insert", f"EXISTS ({_TELLS_OF_PRUNING})")
        _postgresql_trigger(table, "update")
    _postgresql_trigger("prunings", "delete")
    _postgresql_trigger(
        "documents_to_prune", "delete", "NOT EXISTS (SELECT 1 FROM documents WHERE documents.sha256 = OLD.sha256)"
    )
    op.execute(
        "CREATE FUNCTION distalock_documents_deleted() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
        "DELETE FROM documents_to_prune WHERE sha256 = OLD.sha256; RETURN NULL; END $$"
    )
    op.execute(
        "CREATE TRIGGER documents_deleted AFTER DELETE ON documents FOR EACH ROW "
        "EXECUTE FUNCTION distalock_documents_deleted()"
    )
    for table in _UNIQUE:
        _postgresql_trigger(table, "truncate")


def _postgresql_trigger(table: str, verb: str, allowed: str = "FALSE") -> None:
    name = f"{table}_refuse_{verb}"
    row = {"delete": "OLD", "truncate": "NULL"}.get(verb, "NEW")
    op.execute(
        f"CREATE FUNCTION distalock_{name}() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
        f"IF {allowed} THEN RETURN {row}; END IF; "
        f"RAISE EXCEPTION '{table} are append-only' USING ERRCODE = 'integrity_constraint_violation'; END $$"
    )
    each = "STATEMENT" if verb == "truncate" else "ROW"
    op.execute(
        f"CREATE TRIGGER {name} BEFORE {verb.upper()} ON {table} FOR EACH {each} EXECUTE FUNCTION distalock_{name}()"
    )

"""Rows that a backup copies from one database into another: of every table, or of none with a reason."""

from services.ui_api.record.rows import COPIED, NOT_COPIED
from services.ui_api.record.tables import METADATA


def test_every_table_is_copied_or_an_exception_with_a_reason() -> None:
    assert {table.name for table in (*COPIED, *NOT_COPIED)} == set(METADATA.tables)
    assert not set(COPIED) & set(NOT_COPIED)
    assert all(NOT_COPIED.values())


def test_rows_are_copied_after_those_that_they_refer_to() -> None:
    for place, table in enumerate(COPIED):
        for key in table.foreign_keys:
            assert key.column.table in COPIED[:place], f"{table.name} refers to {key.column.table.name}"

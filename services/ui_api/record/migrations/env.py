"""Run by Alembic: migrates over the connection that `record.database` hands over."""

from alembic import context

from services.ui_api.record.tables import METADATA

connection = context.config.attributes["connection"]
context.configure(connection=connection, target_metadata=METADATA, transaction_per_migration=True)
with context.begin_transaction():
    context.run_migrations()

"""Schema of the case record, as Alembic migrations that travel inside the package."""

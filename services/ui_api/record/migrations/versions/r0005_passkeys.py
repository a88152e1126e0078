"""Passkeys of accounts; accounts of an identity provider, and how each session was opened."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the table and the columns; sessions of before were opened with a password."""
    op.create_table(
        "passkeys",
        sa.Column("id", sa.String(1400), primary_key=True),
        sa.Column("user_name", sa.String(64), sa.ForeignKey("users.name"), nullable=False),
        sa.Column("label", sa.String(64), nullable=False),
        sa.Column("public_credential", sa.LargeBinary, nullable=False),
        sa.Column("uses", sa.BigInteger, nullable=False),
        sa.Column("created_at_ns", sa.BigInteger, nullable=False),
    )
    op.create_index("ix_passkeys_user_name", "passkeys", ["user_name"])
    op.add_column("users", sa.Column("provider_subject", sa.Text, nullable=True))
    op.create_index("ix_users_provider_subject", "users", ["provider_subject"], unique=True)
    op.add_column("sessions", sa.Column("authenticated_by", sa.String(32), nullable=False, server_default="password"))


def downgrade() -> None:
    """There is no way back: older versions would take a permit by a passkey for none."""
    raise NotImplementedError("restore a backup that the older version made")

"""The tables of the case record. The migrations make the same; a test compares the two."""

from sqlalchemy import BigInteger, Boolean, Column, ForeignKey, Integer, LargeBinary, MetaData, String, Table, Text

METADATA = MetaData()

EVENTS = Table(
    "events",
    METADATA,
    Column("sequence", Integer, primary_key=True, autoincrement=False),
    Column("at_ns", BigInteger, nullable=False),
    Column("case_id", String(64), nullable=True, index=True),
    Column("who", String(128), nullable=False),
    Column("why", Text, nullable=False),
    Column("kind", String(64), nullable=False),
    Column("data_json", Text, nullable=False),
    Column("previous_sha256", String(64), nullable=False, unique=True),
    Column("sha256", String(64), nullable=False, unique=True),
)

DOCUMENTS = Table(
    "documents",
    METADATA,
    Column("sha256", String(64), primary_key=True),
    Column("media_type", String(128), nullable=False),
    Column("content", LargeBinary, nullable=False),
)

# What may be pruned, each with the event that records it; the triggers of the migrations look here.
PRUNINGS = Table(
    "prunings",
    METADATA,
    Column("case_id", String(64), primary_key=True),
    Column("event_sequence", Integer, ForeignKey("events.sequence"), nullable=False),
)

DOCUMENTS_TO_PRUNE = Table(
    "documents_to_prune",
    METADATA,
    Column("sha256", String(64), primary_key=True),
    Column("event_sequence", Integer, ForeignKey("events.sequence"), nullable=False),
)

# One row, written over and over to see that the database takes what is written.
PROBE = Table("probe", METADATA, Column("id", Integer, primary_key=True), Column("at_ns", BigInteger, nullable=False))

ANSWERS = Table(
    "answers",
    METADATA,
    Column("idempotency_key", String(255), primary_key=True),
    Column("request_sha256", String(64), nullable=False),
    Column("status", Integer, nullable=False),
    Column("headers_json", Text, nullable=False),
    Column("body_json", Text, nullable=False),
    Column("event_sequence", Integer, ForeignKey("events.sequence"), nullable=True),
    Column("answered_at_ns", BigInteger, nullable=False),
)

# Accounts are no part of the log: they are changed, and their secrets stand in no event.
USERS = Table(
    "users",
    METADATA,
    Column("name", String(64), primary_key=True),
    Column("roles_json", Text, nullable=False),
    Column("password_hash", Text, nullable=False),
    Column("disabled", Boolean, nullable=False),
    Column("created_at_ns", BigInteger, nullable=False),
    # issuer and subject of an account of an identity provider; its password is none
    Column("provider_subject", Text, nullable=True, index=True, unique=True),
)

PASSKEYS = Table(
    "passkeys",
    METADATA,
    Column("id", String(1400), primary_key=True),  # a credential id has up to 1023 bytes
    Column("user_name", String(64), ForeignKey("users.name"), nullable=False, index=True),
    Column("label", String(64), nullable=False),
    Column("public_credential", LargeBinary, nullable=False),
    Column("uses", BigInteger, nullable=False),
    Column("created_at_ns", BigInteger, nullable=False),
)

SESSIONS = Table(
    "sessions",
    METADATA,
    Column("id", String(64), primary_key=True),
    Column("user_name", String(64), ForeignKey("users.name"), nullable=False, index=True),
    Column("opened_at_ns", BigInteger, nullable=False),
    Column("ends_at_ns", BigInteger, nullable=False),
    Column("authenticated_by", String(32), nullable=False, server_default="password"),
)

# Of each session all of its refresh tokens, by their hash: one that was used before is recognised.
REFRESH_TOKENS = Table(
    "refresh_tokens",
    METADATA,
    Column("sha256", String(64), primary_key=True),
    Column("session_id", String(64), ForeignKey("sessions.id", ondelete="CASCADE"), nullable=False, index=True),
    Column("used", Boolean, nullable=False),
)

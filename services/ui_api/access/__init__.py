"""Accounts, sessions, and who may do what: see `core.roles` for the table."""

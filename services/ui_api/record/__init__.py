"""Adapter to the case record's database: an append-only, hash-chained event log beside content-addressed documents."""

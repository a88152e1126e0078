"""The private authority of an installation: its key, and one certificate per service."""

"""A running room upgraded service by service, and taken back."""

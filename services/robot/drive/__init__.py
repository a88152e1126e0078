"""Carries the motion table out on a controller: one thread works, any thread may stop."""

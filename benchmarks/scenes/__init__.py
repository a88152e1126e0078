"""Seeded scenes, set-ups and films that the benchmarks render."""
